"""Random motions are the same under different OpenBLAS kernels, that is on different processors."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

KERNELS = {  # kernel -> instructions that it needs, as older and newer versions of numpy call them
    "Nehalem": {"SSE42", "X86_V2"},
    "Haswell": {"AVX2", "X86_V3"},
    "SkylakeX": {"AVX512_SKX", "X86_V4"},
}
CODE = """
import sys
import numpy as np
from signid.model import Model, stated_inertials, stated_laws
from signid.robot import load_robot
from signid.simulation.excite import excite
from signid.simulation.excite.families import Fourier
from signid.simulation.excite.random_motions import rest_to_rest_motion

robot = load_robot("3r")
model = Model(robot, stated_inertials(robot), stated_laws(robot))
t = np.linspace(0, 7.3, 50)
found = {f"basis {periods}": Fourier(7.3, 5, periods / 7.3).basis(t) for periods in (1, 1.5, 2.25, 4)}
found["demo"] = rest_to_rest_motion(robot, 16.0, 0.004, 1).q
found["excite"] = excite(model, kind="random", duration=8.0, harmonics=5).trajectory.q
np.savez(sys.argv[1], **found)
"""


def available() -> list[str]:
    """Kernels that numpy's OpenBLAS can be asked for on this machine."""
    config = np.show_config("dicts")
    if platform.machine() not in ("x86_64", "AMD64") or "openblas" not in config["Build Dependencies"]["blas"]["name"]:
        return []
    simd = {*config["SIMD Extensions"]["baseline"], *config["SIMD Extensions"]["found"]}
    return [name for name, needed in KERNELS.items() if needed & simd]


@pytest.mark.skipif(len(available()) < 2, reason="numpy does not use OpenBLAS, or the processor has one kernel only")
def test_random_motions_do_not_depend_on_the_kernel(tmp_path: Path) -> None:
    found = []
    for kernel in available():
        file = tmp_path / f"{kernel}.npz"
        environment = {**os.environ, "OPENBLAS_CORETYPE": kernel}
        subprocess.run([sys.executable, "-c", CODE, str(file)], env=environment, check=True)
        found.append(dict(np.load(file)))
    for other in found[1:]:
        for name, expected in found[0].items():
            assert_allclose(other[name], expected, rtol=0, atol=1e-9 * np.abs(expected).max(), err_msg=name)
