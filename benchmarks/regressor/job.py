"""Benchmark job: an arm along a periodic motion, with known drives."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signid.regression.motion import Motion
from signid.robot import hold, load_robot
from signid.types import Robot

from ..plants.bodies import Drives

Array = NDArray[np.float64]

ROBOTS = {"panda": ("panda_finger_joint1",), "ur10": ()}  # joints held at zero
SAMPLES, RATE, PERIOD, HARMONICS, REACH = (
    10_000,
    100.0,
    10.0,
    5,
    1.8,
)  # samples, rate [Hz], period [s], harmonics, amplitude [rad]
DRIVES = {
    "armature": (0.8, 0.1),
    "viscous_friction": (3.0, 0.3),
    "coulomb_friction": (6.0, 0.5),
}  # from base to tip [kg.m2], [N.m.s/rad], [N.m]


class Track(NamedTuple):
    """True motion and torque of an arm."""

    q: Array  # (N, n) [rad]
    v: Array  # (N, n) [rad/s]
    a: Array  # (N, n) [rad/s2]
    tau: Array  # (N, n) [N.m]


def load(name: str) -> Robot:
    """Load the arm with fingers held."""
    return hold(load_robot(name), dict.fromkeys(ROBOTS[name], 0.0))


def move(robot: Robot, seed: int) -> Track:
    """Draw a motion of five harmonics and compute its torque."""
    n, order = len(robot.joints), np.arange(1, HARMONICS + 1)
    sines, cosines = np.random.default_rng(seed).standard_normal((2, n, HARMONICS))
    size = REACH / np.sum(np.hypot(sines, cosines), axis=1)[:, None] * (sines + 1j * cosines)
    t, w = np.arange(SAMPLES) / RATE, 2 * np.pi * order / PERIOD
    q, v, a = (np.imag(np.exp(1j * np.outer(t, w)) @ (size * (1j * w) ** k).T) for k in range(3))
    own = drives(robot)
    rubbing = own.viscous_friction * v + own.coulomb_friction * np.sign(v)
    return Track(q, v, a, Motion(robot, t, q, v, a).load + own.armature * a + rubbing)


def drives(robot: Robot) -> Drives:
    """True drives of the robot."""
    n = len(robot.joints)
    return replace(Drives.none(n), **{name: np.linspace(*ends, n) for name, ends in DRIVES.items()})
