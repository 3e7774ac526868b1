"""Motions, random or optimised, have the same bytes under different OpenBLAS kernels (processors)."""

from pathlib import Path

import numpy as np
import pytest
from kernels import available, run_python, several

CODE = """
import sys
import numpy as np
from signid.model import Model, stated_inertials, stated_laws
from signid.robot import load_robot
from signid.simulation.excite import excite
from signid.simulation.excite.families import Fourier
from signid.simulation.excite.families import rest_to_rest_motion
from signid.simulation.excite.design import Budget

robot = load_robot("3r")
model = Model(robot, stated_inertials(robot), stated_laws(robot))
t = np.linspace(0, 7.3, 50)
found = {f"basis {periods}": Fourier(7.3, 5, periods / 7.3).basis(t) for periods in (1, 1.5, 2.25, 4)}
found["demo"] = rest_to_rest_motion(robot, 16.0, 0.004, 1).q
found["random"] = excite(model, kind="random", duration=8.0, harmonics=5).trajectory.q
budget = Budget(pool=10, starts=1, short=60, long=150, firm=30)
for kind in ("fourier", "spline"):
    found[kind] = excite(model, kind=kind, duration=4.0, harmonics=5, budget=budget).trajectory.q
np.savez(sys.argv[1], **found)
"""


@pytest.mark.slow
@several
def test_motions_do_not_depend_on_the_kernel(tmp_path: Path) -> None:
    found = []
    for kernel in available():
        run_python(kernel, ["-c", CODE, f"{kernel}.npz"], tmp_path)
        found.append(dict(np.load(tmp_path / f"{kernel}.npz")))
    for other in found[1:]:
        for name, expected in found[0].items():
            assert other[name].tobytes() == expected.tobytes(), name
