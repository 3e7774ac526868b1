"""Short windows of recordings and their simulation for many copies of the drives (multiple shooting)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...servos import Servo, ServoGrid
from ...types import Array, Indices, Mask
from ..plant.course import FIT_SUBSTEP, Copies, JoinedGrids, RobotCourse, substeps
from ..plant.kernel import LoopBodies, Starts, simulate

MOST_VALUES = 6_000_000  # positions simulated at a time


@dataclass(frozen=True, eq=False)
class FitWindows:
    """W windows of recordings of n coupled joints; T: rows of the longest one + 1."""

    joined: JoinedGrids
    bodies: LoopBodies  # along the motion that the robot is linear about
    first: Indices  # (W,) first row, of all recordings
    rows: Indices  # (W,) rows that are simulated
    q0: Array  # (W, n) [rad or m] smoothed, at the start
    v0: Array  # (W, n) [rad/s or m/s] smoothed, at the start
    longest: int  # T - 1
    branches: tuple[tuple[tuple[int, ...], FitWindows], ...] = ()  # independent ones: their joints, and these alone

    @cached_property
    def inside(self) -> Mask:
        """Which of the rows (W, T) a window has."""
        return np.arange(self.longest + 1) <= self.rows[:, None]

    @property
    def places(self) -> Indices:
        """Rows of all recordings (W, T); the last one of a window stands for those after it."""
        return np.asarray(self.first[:, None] + np.minimum(np.arange(self.longest + 1), self.rows[:, None]))

    @cached_property
    def measured(self) -> Array:
        """Positions (W, T, n) [rad or m], zero after a window."""
        return np.asarray(np.where(self.inside[:, :, None], self.joined.column("q")[self.places], 0.0))

    def __len__(self) -> int:
        return len(self.first)

    def part(self, some: slice) -> FitWindows:
        """Some of the windows."""
        branches = tuple((joints, branch.part(some)) for joints, branch in self.branches)
        new = replace(self, first=self.first[some], rows=self.rows[some], branches=branches)
        return replace(new, q0=self.q0[some], v0=self.v0[some])

    def apart(self, branches: Sequence[Sequence[int]]) -> FitWindows:
        """The same, whose branches are simulated one by one: joints that share no moved body."""
        return replace(self, branches=tuple((tuple(joints), self._only(list(joints))) for joints in branches))

    def _only(self, joints: list[int]) -> FitWindows:
        x, square = self.bodies, np.ix_(range(len(self.bodies.bias)), joints, joints)
        mass, by_q, by_v = (np.ascontiguousarray(one[square]) for one in (x.mass, x.by_q, x.by_v))
        bias, q, v = (np.ascontiguousarray(one[:, joints]) for one in (x.bias, x.q, x.v))
        joined = JoinedGrids(self.joined.grids, tuple(self.joined.joints[j] for j in joints), self.joined.parts)
        bodies = LoopBodies(mass, bias, by_q, by_v, q, v, x.wave[joints])
        return replace(self, joined=joined, bodies=bodies, q0=self.q0[:, joints], v0=self.v0[:, joints])


def windows_of(
    grids: Sequence[ServoGrid],
    joints: Sequence[int],
    servos: Sequence[Servo],
    courses: Sequence[RobotCourse],
    places: Sequence[tuple[int, int, int]],
    about: Sequence[RobotCourse] = (),
    *,
    longest: float = FIT_SUBSTEP,
) -> FitWindows:
    """Windows of n joints at places: index of a grid, first row and rows.

    Args:
        grids: recordings, all of the same joints and one rate.
        joints: columns of the grids.
        servos: n drives, the stiffest ones of the fit.
        courses: of the joints along each recorded motion.
        places: of the windows.
        about: courses along the motions that the robot is linear about, of as many rows as the grids or a multiple;
            default: along the recorded ones.
        longest: substep [s].
    """
    inertia = np.min([np.diagonal(along.mass, axis1=1, axis2=2).min(0) for along in courses], axis=0)
    finer = sum(len(along.bias) for along in about) // sum(map(len, grids)) if about else 1
    joined = JoinedGrids(tuple(grids), tuple(joints), substeps(grids[0].step, servos, inertia, finer, longest))
    grid, first, rows = np.array(places).T
    first = np.cumsum([0, *map(len, grids)])[grid] + first
    q, v = (np.concatenate([along.motion[k] for along in courses])[first] for k in range(2))
    return FitWindows(joined, joined_bodies(about or courses), first, rows, q, v, int(rows.max()))


def joined_bodies(courses: Sequence[RobotCourse]) -> LoopBodies:
    """Bodies along the motions of several recordings, one after another."""
    bodies = [along.bodies for along in courses]
    columns = [np.concatenate(each) for each in zip(*bodies, strict=True)]
    return LoopBodies(*columns)._replace(wave=bodies[0].wave)


def window_places(grids: Sequence[ServoGrid], window: float) -> list[tuple[int, int, int]]:
    """Index of the grid, first row and rows of windows [s], one after another; a short grid is one window."""
    places = []
    for k, grid in enumerate(grids):
        rows = min(max(int(round(window * grid.rate)), 3), len(grid) - 1)
        places += [(k, first, rows) for first in range(0, len(grid) - rows, rows)]
    return places


def shoot(
    windows: FitWindows, copies: Copies, q0: Array, v0: Array, bodies: LoopBodies | None = None
) -> tuple[Array, Array]:
    """Positions (C, W, T, n), zero after a window, and saturated substeps (C, W, n) of C copies.

    q0: (C, W, n) [rad or m]; v0: (C, W, n) [rad/s or m/s]; bodies: other ones.
    """
    if windows.branches and bodies is None:
        return _shoot_apart(windows, copies, q0, v0)
    starts = Starts(windows.first, windows.rows, windows.longest, np.ascontiguousarray(q0), np.ascontiguousarray(v0))
    positions, saturated = simulate(bodies or windows.bodies, windows.joined.drives(copies), starts)
    return positions, saturated


def _shoot_apart(windows: FitWindows, copies: Copies, q0: Array, v0: Array) -> tuple[Array, Array]:
    """As `shoot`, a branch at a time; copies that are the same in a branch are simulated there once."""
    count = len(copies.numbers)
    positions = np.empty((count, *windows.measured.shape))
    saturated = np.empty((count, *windows.q0.shape))
    for joints, branch in windows.branches:
        own = list(joints)
        numbers, laws, q, v = copies.numbers[:, own], copies.laws[:, own], q0[:, :, own], v0[:, :, own]
        rows = np.concatenate([x.reshape(count, -1) for x in (numbers, laws, q, v)], axis=1)
        _, first, same = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        drives = Copies(numbers[first], laws[first], tuple(copies.kd_on[j] for j in own))
        found = shoot(branch, drives, q[first], v[first])
        positions[..., own], saturated[..., own] = (x[same.ravel()] for x in found)
    return positions, saturated
