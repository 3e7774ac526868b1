"""Changes of torque by a motion that is recorded elsewhere."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import signid
from signid.regression.motion import Motion

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("angle", [0.003, -0.7])
def test_torque_of_a_turned_joint_is_exact(joint: int, angle: float) -> None:
    """The interpolated load equals inverse dynamics at the turned positions."""
    robot = signid.load_robot(ROOT / "robots" / "panda" / "arm.urdf")
    q, v, a = np.random.default_rng(0).normal(size=(3, 40, 7))
    motion = Motion(robot, np.arange(40) * 0.01, q, v, a)
    expected = motion.load - replace(motion, q=q - angle * np.eye(7)[joint]).load
    np.testing.assert_allclose(motion.shift(joint, np.full(40, angle), exactly=True), expected, atol=1e-12)
