"""The robot along recorded motions: mass, bias and their derivatives by Pinocchio; joints in coupled groups."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline
from scipy.signal import butter, filtfilt

from ...model import Model
from ...robot import configuration, hold, resting
from ...robot.dynamics import moved_bodies, rigid_torque, sensitivity
from ...servos import ServoGrid
from ...types import Array, Robot
from .kernel import LoopBodies

CUTOFF = 20.0  # [Hz] of the filter without delay that gives speeds and accelerations
ORDER = 3


class Moved(NamedTuple):
    """Smooth motion of n joints at N rows."""

    q: Array  # (N, n) [rad or m]
    v: Array  # (N, n) [rad/s or m/s]
    a: Array  # (N, n) [rad/s2 or m/s2]


@dataclass(frozen=True, eq=False)
class RobotCourse:
    """The robot linear about a motion, over n joints and N rows.

    torque = mass a + bias + by_q (q - q of the motion) + by_v (v - v of the motion) + wave (sin q, cos q).
    """

    motion: Moved
    torque: Array  # (N, n) [N.m or N] of the motion, without drives
    mass: Array  # (N, n, n) [kg.m2 or kg] at each row
    bias: Array  # (N, n) [N.m or N]
    by_q: Array  # (N, n, n) [N.m/rad]
    by_v: Array  # (N, n, n) [N.m.s/rad]
    wave: Array  # (n, 2) [N.m] coefficients of sin q and cos q: a single joint, exactly

    @property
    def bodies(self) -> LoopBodies:
        """The same as the compiled closed loop reads it."""
        middle = np.concatenate([0.5 * (self.mass[:-1] + self.mass[1:]), self.mass[-1:]])
        each = (middle, self.bias, self.by_q, self.by_v, self.motion.q, self.motion.v, self.wave)
        return LoopBodies(*map(np.ascontiguousarray, each))


def bodies_of(model: Model, joints: Sequence[str]) -> Robot:
    """Robot with the bodies of a model, whose joints are those of a recording; the others are held at rest."""
    whole = model.bodies()
    whole.armature = np.zeros(whole.nv)
    robot = replace(model.robot, model=whole)
    return hold(robot, resting(robot, joints))


def smooth(q: Array, rate: float, cutoff: float = CUTOFF) -> Moved:
    """Filter positions q (N, n) [rad or m] without delay and differentiate them."""
    b, a = butter(ORDER, 2 * min(cutoff / rate, 0.4))
    even = filtfilt(b, a, q, axis=0, padlen=min(len(q) - 1, int(3 * rate / cutoff)))
    v = np.gradient(even, 1 / rate, axis=0, edge_order=2)
    return Moved(even, v, np.gradient(v, 1 / rate, axis=0, edge_order=2))


def refined(q: Array, rate: float, finer: int) -> Moved:
    """Motion through positions q (N, n) [rad or m] by splines, at `finer` times as many rows; the last ones repeat."""
    path = CubicSpline(np.arange(len(q)) / rate, q)
    at = np.minimum(np.arange(len(q) * finer) / finer, len(q) - 1) / rate
    return Moved(path(at), path(at, 1), path(at, 2))


def course(robot: Robot, motion: Moved) -> RobotCourse:
    """Mass, bias and derivatives along a motion of all joints of a robot."""
    q = configuration(robot, motion.q)
    v, a = motion.v @ robot.drive.T, motion.a @ robot.drive.T
    torque, by = rigid_torque(robot, q, v, a), sensitivity(robot, q, v, a)
    bias = torque - np.einsum("tij,tj->ti", by.acceleration, motion.a)
    wave = np.zeros((len(robot.joints), 2))
    by_q, by_v = by.position, by.velocity
    if single(robot):
        wave = _wave(robot)
        angle = motion.q[:, 0]
        bias = bias - (wave[0, 0] * np.sin(angle) + wave[0, 1] * np.cos(angle))[:, None]
        by_q, by_v = np.zeros_like(by_q), np.zeros_like(by_v)
    return RobotCourse(motion, torque, by.acceleration, bias, by_q, by_v, wave)


@lru_cache(maxsize=32)
def recorded_course(model: Model, grid: ServoGrid) -> RobotCourse:
    """Course of all joints along the smooth motion of a grid; the last ones are kept."""
    return course(bodies_of(model, grid.joints), motion_of(grid))


def part(whole: RobotCourse, joints: Sequence[int]) -> RobotCourse:
    """Course of some joints; the others move as the motion does."""
    rows = list(joints)
    motion = Moved(*(x[:, rows] for x in whole.motion))
    mass = whole.mass[:, rows][:, :, rows]
    wave = whole.wave[rows]
    bias = whole.torque[:, rows] - np.einsum("tij,tj->ti", mass, motion.a)
    bias = bias - wave[:, 0] * np.sin(motion.q) - wave[:, 1] * np.cos(motion.q)
    by_q, by_v = (x[:, rows][:, :, rows] for x in (whole.by_q, whole.by_v))
    return RobotCourse(motion, whole.torque[:, rows], mass, bias, by_q, by_v, wave)


def groups(robot: Robot, joints: Sequence[int]) -> tuple[tuple[int, ...], ...]:
    """Joints in groups that share no moved body; torques of different groups are independent."""
    moved = moved_bodies(robot)
    found: list[set[int]] = []
    for joint in joints:
        linked = [group for group in found if any((moved[joint] & moved[other]).any() for other in group)]
        found = [group for group in found if group not in linked] + [{joint}.union(*linked)]
    return tuple(sorted(tuple(sorted(group)) for group in found))


def motion_of(grid: ServoGrid) -> Moved:
    """Smooth motion of a grid."""
    return smooth(grid.q, grid.rate)


def single(robot: Robot) -> bool:
    """Whether a robot is one revolute joint without mimic joints: its gravity torque is a wave of q, its mass fixed."""
    return len(robot.joints) == 1 and not robot.prismatic[0] and np.count_nonzero(robot.drive) == 1


def _wave(robot: Robot) -> Array:
    """Coefficients (1, 2) of sin q and cos q in the gravity torque of a single joint [N.m]."""
    data, scale = robot.model.createData(), robot.drive
    at = configuration(robot, np.array([[0.0], [np.pi / 2], [np.pi], [-np.pi / 2]]))
    torque = [float((pin.computeGeneralizedGravity(robot.model, data, q) @ scale)[0]) for q in at]
    return np.array([[(torque[1] - torque[3]) / 2, (torque[0] - torque[2]) / 2]])
