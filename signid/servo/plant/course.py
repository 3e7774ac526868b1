"""The robot along recorded motions: mass, bias and their derivatives by Pinocchio; joints in coupled groups."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, filtfilt

from ...model import Model
from ...robot import configuration, hold, resting
from ...robot.dynamics import moved_bodies, rigid_torque, sensitivity
from ...servos import DRIVE_LAWS, LOOP_NUMBERS, Servo, ServoGrid
from ...types import Array, Indices, Robot
from .grid import commands_at
from .kernel import BACKLASH_STEP, LoopBodies
from .torque import DELAY, PROFILE, Drives

CUTOFF = 20.0  # [Hz] of the filter without delay that gives speeds and accelerations
ORDER = 3
FIT_SUBSTEP, SEARCH_SUBSTEP, MAX_ROW_SUBSTEPS = 0.002, 0.004, 32  # [s] in fits, and searches for laws; of a row
TURN = 0.35  # [rad] of the fastest oscillation in a substep
MAX_KEPT_VALUES = 4_000_000  # values of commands that are kept, [32 MB]


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
        at = configuration(robot, np.array([[0.0], [np.pi / 2], [np.pi], [-np.pi / 2]]))
        weight = rigid_torque(robot, at, *np.zeros((2, 4, robot.model.nv)))[:, 0]
        wave = np.array([[(weight[1] - weight[3]) / 2, (weight[0] - weight[2]) / 2]])
        angle = motion.q[:, 0]
        bias = bias - (wave[0, 0] * np.sin(angle) + wave[0, 1] * np.cos(angle))[:, None]
        by_q, by_v = np.zeros_like(by_q), np.zeros_like(by_v)
    return RobotCourse(motion, torque, by.acceleration, bias, by_q, by_v, wave)


@lru_cache(maxsize=24)
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


def substeps(step: float, servos: Sequence[Servo], inertia: Array, finer: int = 1, longest: float = FIT_SUBSTEP) -> int:
    """Substeps of a row: of at most `longest` [s], and short against the fastest oscillation of the loop.

    step: of a row [s]; inertia: (n,) of the robot at the joints [kg.m2 or kg]; finer: their number is a multiple of it.
    """
    fastest = 0.0
    for servo, own in zip(servos, inertia, strict=True):
        natural = np.sqrt((servo.kp + servo.spring_stiffness) / (whole := max(servo.armature + own, 1e-9)))
        ratio = max(servo.damping / max(2 * natural * whole, 1e-12), 1.0)  # beyond 1 the slow mode counts
        fastest = max(fastest, natural * (ratio - np.sqrt(ratio**2 - 1)))
    short = any(servo.backlash_gap > 0 or servo.gear_exponent > 0 for servo in servos)
    longest = min(BACKLASH_STEP, longest) if short else longest
    count = np.clip(np.ceil(step * max(1 / longest, fastest / TURN) - 1e-9), 1, MAX_ROW_SUBSTEPS)
    return finer * int(np.ceil(count / finer))


class Copies(NamedTuple):
    """C copies of the drives of n joints."""

    numbers: Array  # (C, n, 32) [LOOP_UNITS] in the order of LOOP_NUMBERS
    laws: Indices  # (C, n) index in DRIVE_LAWS
    kd_on: tuple[str, ...]  # n


def copies_of(copies: Sequence[Sequence[Servo]]) -> Copies:
    """Drives of n joints as arrays, of each of C copies; what damping acts on is that of the first copy."""
    numbers = [[[getattr(servo, name) for name in LOOP_NUMBERS] for servo in servos] for servos in copies]
    laws = [[DRIVE_LAWS.index(servo.law) for servo in servos] for servos in copies]
    return Copies(np.array(numbers, float), np.array(laws), tuple(servo.kd_on for servo in copies[0]))


@dataclass(frozen=True, eq=False)
class JoinedGrids:
    """Recordings of n joints, one after another: R rows."""

    grids: tuple[ServoGrid, ...]
    joints: tuple[int, ...]  # n columns of the grids
    parts: int  # substeps of a row
    _held: dict[tuple[int, str, float, float], Array] = field(default_factory=dict)

    def column(self, name: str) -> Array:
        """Values (R, n) of a field of the grids."""
        rows = [np.broadcast_to(getattr(grid, name), grid.q.shape)[:, self.joints] for grid in self.grids]
        return np.ascontiguousarray(np.concatenate(rows))

    @cached_property
    def _supply(self) -> tuple[Array, Array, Array]:
        """Whether a drive holds, voltage and firmware gain, each (R, n) [1]."""
        return self.column("on"), self.column("voltage"), self.column("gain")

    def drives(self, copies: Copies) -> Drives:
        """Copies of drives along these rows."""
        found: dict[tuple[int, str, float, float], int] = {}
        variant = np.empty(copies.laws.shape, dtype=np.intp)
        for c, copy in enumerate(copies.numbers):
            for j, p in enumerate(copy):
                key = (j, copies.kd_on[j], float(p[DELAY]), float(p[PROFILE]))
                variant[c, j] = found.setdefault(key, len(found))
        commands = np.stack([self._commands(*key) for key in found], axis=1)
        step = self.grids[0].step / self.parts
        return Drives(copies.numbers, copies.laws, variant, commands, *self._supply, self.parts, step)

    def _commands(self, j: int, kd_on: str, delay: float, profile: float) -> Array:
        """Commands (7, R parts) of a joint; the last ones are kept."""
        key = (j, kd_on, delay, profile)
        if key not in self._held:
            if sum(each.size for each in self._held.values()) > MAX_KEPT_VALUES:
                self._held.clear()
            each = [commands_at(grid, self.joints[j], kd_on, delay, profile, self.parts) for grid in self.grids]
            self._held[key] = np.concatenate(each, axis=1)
        return self._held[key]
