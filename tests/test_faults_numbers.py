"""The numerical parts of the recording checks against SciPy."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import nnls

from signid.faults.evidence import nonnegative


def test_coefficients_are_those_of_scipy() -> None:
    rng = np.random.default_rng(0)
    for trial in range(500):
        k = int(rng.integers(1, 5))
        a, b = rng.normal(size=(k + int(rng.integers(0, 3)), k)), rng.normal(size=0)
        b = rng.normal(size=len(a))
        if trial % 3 == 0 and k > 1:
            a[:, 0] = a[:, 1] + (trial % 2) * 1e-3 * rng.normal(size=len(a))
        x = nonnegative((a.T @ a)[None], (a.T @ b)[None, :, None])[0, :, 0]
        assert np.all(x >= 0)
        assert np.linalg.norm(a @ x - b) <= nnls(a, b)[1] + 1e-6
    assert not nonnegative(np.zeros((1, 2, 2)), np.zeros((1, 2, 3))).any()


def test_faults_of_torque_need_no_compiled_code() -> None:
    robot = Path(__file__).parents[1] / "robots" / "3r"
    code = f"""
import sys, signid
robot = signid.load_robot({str(robot / "robot.urdf")!r})
signid.identify(robot, [signid.read_recording({str(robot / "recording.parquet")!r}, robot)])
assert "numba" not in sys.modules
assert not [name for name in sys.modules if name == "signid.servo" or name.startswith("signid.servo.")]
"""
    subprocess.run([sys.executable, "-c", code], check=True)
