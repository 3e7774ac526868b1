"""The numerical parts of the recording checks against SciPy."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import nnls

from signid.faults.evidence import Curve, nonnegative


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


def test_a_curve_goes_through_its_samples_and_between_them() -> None:
    t = np.arange(100) / 8.0
    curve = Curve(t, np.stack([np.sin(2 * np.pi * t), t**3], axis=1))
    assert np.allclose(curve.at(t), curve.x, atol=1e-9)
    between = np.linspace(1.0, 11.0, 500)
    assert np.abs(curve.at(between)[:, 0] - np.sin(2 * np.pi * between)).max() < 1e-3
    assert np.allclose(curve.at(between)[:, 1], between**3)
    assert np.array_equal(curve.at(np.array([-1.0, 99.0])), curve.x[[0, -1]])


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
