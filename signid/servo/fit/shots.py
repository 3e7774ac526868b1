"""Short windows of recordings and their simulation for many copies of the numbers (multiple shooting)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...servos import DRIVE_LAWS, Servo, ServoGrid
from ...types import Array, Indices
from ..plant.commands import commands_at
from ..plant.course import RobotCourse
from ..plant.kernel import DELAY, PROFILE, simulate

MOST_VALUES = 6_000_000  # positions simulated at a time


@dataclass(frozen=True, eq=False)
class Shots:
    """Windows of one grid for n coupled joints; q0, v0 (W, n) are the measured states at their starts."""

    grid: ServoGrid
    joints: tuple[int, ...]  # n columns of the grid
    starts: Indices  # (W,) first rows
    rows: int  # of a window
    parts: int  # substeps of a row
    course: RobotCourse
    q0: Array  # (W, n) [rad or m]
    v0: Array  # (W, n) [rad/s or m/s]

    @property
    def measured(self) -> Array:
        """Positions (W, rows + 1, n) [rad or m]."""
        return np.asarray(self.grid.q[self.places][:, :, list(self.joints)])

    @property
    def places(self) -> Indices:
        """Rows of the grid (W, rows + 1)."""
        return np.asarray(self.starts[:, None] + np.arange(self.rows + 1))


def window_starts(grid: ServoGrid, window: float) -> tuple[Indices, int]:
    """First rows of the windows of a grid, and rows of a window."""
    rows = min(max(int(round(window * grid.rate)), 3), len(grid) - 1)
    return np.arange(0, len(grid) - rows, rows), rows


def build_shots(
    grid: ServoGrid, joints: Sequence[int], course: RobotCourse, measured: RobotCourse, window: float, parts: int
) -> Shots:
    """Windows of a grid; `course` is the motion the robot is linear about, `measured` the recorded one."""
    starts, rows = window_starts(grid, window)
    return Shots(grid, tuple(joints), starts, rows, parts, course, measured.motion.q[starts], measured.motion.v[starts])


def shoot(shots: Shots, servos: Sequence[Servo], copies: Array, q0: Array, v0: Array) -> tuple[Array, Array]:
    """Positions (C, W, rows + 1, n) and saturated substeps (C, W, n) of C copies.

    servos: laws of n drives; copies: (C, n, 13) their numbers [SERVO_UNITS].
    q0: (C, W, n) [rad or m]; v0: (C, W, n) [rad/s or m/s].
    """
    grid, course, parts, joints = shots.grid, shots.course, shots.parts, list(shots.joints)
    variant, held = _variants(shots, servos, copies)
    out = np.empty((*q0.shape[:2], shots.rows + 1, len(joints)))
    saturated = np.empty(q0.shape)
    simulate(  # type: ignore[call-arg]
        shots.starts, shots.rows, parts, grid.step / parts, course.middle, *map(np.ascontiguousarray, (
            course.bias, course.by_q, course.by_v, course.motion.q, course.motion.v, course.wave, held, variant,
            grid.on[:, joints], grid.voltage[:, joints], grid.gain[joints], copies,
        )), np.array([DRIVE_LAWS.index(servo.law) for servo in servos]), q0, v0, out, saturated,
    )  # fmt: skip
    return out, saturated


def _variants(shots: Shots, servos: Sequence[Servo], copies: Array) -> tuple[Indices, Array]:
    """Variant (C, n) of the command of each copy and joint, and commands (7, V, N parts)."""
    found: dict[tuple[int, float, float], int] = {}
    variant = np.empty(copies.shape[:2], dtype=np.intp)
    for c, copy in enumerate(copies):
        for j, p in enumerate(copy):
            variant[c, j] = found.setdefault((j, float(p[DELAY]), float(p[PROFILE])), len(found))
    held = np.empty((7, len(found), len(shots.grid) * shots.parts))
    for (j, delay, profile), v in found.items():
        held[:, v] = commands_at(shots.grid, shots.joints[j], servos[j].kd_on, delay, profile, shots.parts)
    return variant, held
