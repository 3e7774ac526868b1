"""Short windows of recordings (multiple shooting), their simulation and the normal equations of their output error.

The initial states of the windows are eliminated (Schur).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2, t

from ...estimation.repeats import jackknife_variance, spread_between, spread_covariance
from ...servos import Servo, ServoGrid
from ...types import TWO_SIDED, Array, Indices, Mask
from ..plant.course import FIT_SUBSTEP, Copies, JoinedGrids, RobotCourse, substeps
from ..plant.kernel import LoopBodies, Starts, simulate
from .coordinates import DIFFERENCE, Coordinates

STATE = (2e-3, 0.3)  # prior of an initial state about the smoothed one: [rad or m], [rad/s or m/s]
NUDGE = (1e-4, 1e-2)  # differences of initial states
SHARES = (1.0, 0.3, 0.0)  # of the step of a window's state that are tried
WINDOWS_PER_NUMBER = 0.4  # windows that each fitted number takes from the sandwich
NEIGHBOURS = 3  # windows apart that may be correlated
BLOCKS = 6  # of the windows of a recording: of some seconds, since windows a few apart are correlated (Go2)
LEAST_REST = 0.25  # share of the windows of a recording that its numbers leave, below which it is not judged alone
DEPENDENT_PROBABILITY = 0.01  # of such a variance between blocks by chance, below which windows are not independent
MIN_ROBUST_VARIANCE = 1e-24  # variance over the widest one, below which it counts as this
MIN_INFLUENCE = 1e-12  # influence over the largest one, below which a number is not identifiable
MIN_EIGENVALUE = 1e-12  # relative eigenvalue of the information below which a direction is not identifiable
MOST_VALUES = 6_000_000  # positions simulated at a time


class FitPoint(NamedTuple):
    """Where a fit stands: values, and initial states of the windows."""

    values: Array  # (P,) [SERVO_UNITS]
    q0: Array  # (W, n) [rad or m]
    v0: Array  # (W, n) [rad/s or m/s]


class StateSlopes(NamedTuple):
    """Influence of the initial states of W windows: M = T n whitened positions of each."""

    slopes: Array  # (W, M, 2n) [1/rad, s/rad]
    inverse: Array  # (W, 2n, 2n) [products of rad, rad/s] of the information of residual and prior

    def leave(self, residual: Array) -> Array:
        """Whitened residuals after the best initial states of each window; residual: (C, W, T, n) [1]."""
        z = residual.reshape(*residual.shape[:2], -1)
        best = np.einsum("wsu,wmu,cwm->cws", self.inverse, self.slopes, z, optimize=True)
        moved = np.einsum("wms,cws->cwm", self.slopes, best, optimize=True)
        return np.asarray(residual - moved.reshape(residual.shape))


class Normal(NamedTuple):
    """Quadratic model of half the cost about a point, for steps of the values (in SERVO_UNITS)."""

    each: Array  # (W, P, P) [inverse products of SERVO_UNITS] of each window, states eliminated
    scores: Array  # (W, P) [1/SERVO_UNITS] gradient of each window, states eliminated
    across: Array  # (W, P, 2n) [inverse products] values and states
    inverse: Array  # (W, 2n, 2n) [products of rad, rad/s] of the states' information
    state: Array  # (W, 2n) [1/rad, s/rad] gradient of the states

    @property
    def information(self) -> Array:
        """Information (P, P) of all windows [inverse products of SERVO_UNITS]."""
        return np.asarray(self.each.sum(0))


def residuals(windows: FitWindows, where: Coordinates, point: FitPoint) -> Array:
    """Simulated minus measured positions (W, T, n) [rad or m]."""
    simulated = shoot(windows, where.copies(point.values[None]), point.q0[None], point.v0[None])[0][0]
    return np.asarray(simulated - windows.measured)


def settle(
    windows: FitWindows, where: Coordinates, point: FitPoint, step: tuple[Array, Array], noise: Array
) -> tuple[FitPoint, Array]:
    """New values, and for each window the share of the step of its state that fits best; with residuals (W, T, n).

    step: new values (P,) [SERVO_UNITS], and steps (W, 2n) of the states [rad and rad/s, or m and m/s].
    noise: (n,) [rad or m].
    """
    (values, states), n = step, len(noise)
    q = np.array([point.q0 + share * states[:, :n] for share in SHARES])
    v = np.array([point.v0 + share * states[:, n:] for share in SHARES])
    residual = shoot(windows, where.copies(np.repeat(values[None], len(SHARES), 0)), q, v)[0] - windows.measured
    best = np.argmin(_costs(windows, residual, q, v, noise), axis=0), np.arange(len(windows))
    return FitPoint(values, q[best], v[best]), residual[best]


def cost(windows: FitWindows, residual: Array, point: FitPoint, noise: Array) -> float:
    """Weighted squares of residuals and of the states against their prior.

    residual: (W, T, n) [rad or m]; noise: (n,) [rad or m].
    """
    return float(_costs(windows, residual, point.q0, point.v0, noise).sum())


def _costs(windows: FitWindows, residual: Array, q0: Array, v0: Array, noise: Array) -> Array:
    """Cost (..., W) of each window."""
    squares = np.sum((residual / noise) ** 2, axis=(-1, -2))
    prior = np.sum(((q0 - windows.q0) / STATE[0]) ** 2 + ((v0 - windows.v0) / STATE[1]) ** 2, axis=-1)
    return np.asarray(np.where(np.isfinite(squares), squares, np.inf) + prior)


def state_slopes(by_state: Array, noise: Array) -> StateSlopes:
    """Influence of initial states: of positions first, then of speeds.

    by_state: (2n, W, T, n) [1] derivatives of the positions; noise: (n,) [rad or m].
    """
    slopes = np.moveaxis((by_state / noise).reshape(*by_state.shape[:2], -1), 0, 2)
    information = np.swapaxes(slopes, 1, 2) @ slopes + np.diag(_state_prior(len(noise)))
    return StateSlopes(slopes, np.asarray(np.linalg.inv(information)))


class Slopes(NamedTuple):
    """Derivatives of the positions of W windows by P values and by initial states."""

    by_value: Array  # (P, W, T, n) [rad or m over SERVO_UNITS]
    by_state: Array  # (2n, W, T, n) [1, s]


def slopes_at(
    windows: FitWindows, where: Coordinates, point: FitPoint, wide: float = 1.0, central: bool = True
) -> Slopes:
    """Derivatives at a point; `wide` multiplies the differences, central or forward."""
    differences, n = nearby(where, point.values, wide, central), windows.q0.shape[1]
    table = differences.values
    copies, count = where.copies(np.concatenate([table, np.repeat(table[:1], 2 * n, 0)])), len(table)
    most = max(MOST_VALUES // ((count + 2 * n) * (windows.longest + 1) * n), 1)
    parts = []
    for first in range(0, len(windows), most):
        rows = slice(first, first + most)
        q0, v0 = (np.repeat(x[None, rows], count + 2 * n, 0) for x in (point.q0, point.v0))
        for j in range(n):  # one state differs in each of the last 2n copies
            q0[count + j, :, j] += NUDGE[0]
            v0[count + n + j, :, j] += NUDGE[1]
        positions = shoot(windows.part(rows), copies, q0, v0)[0]
        by_state = (positions[count:] - positions[0]) / np.repeat(NUDGE, n)[:, None, None, None]
        parts.append(Slopes(derivatives(positions[:count], where, differences), by_state))
    return Slopes(*(np.concatenate(each, axis=1) for each in zip(*parts, strict=True)))


def normal(windows: FitWindows, slopes: Slopes, residual: Array, point: FitPoint, noise: Array) -> Normal:
    """Normal equations at a point; residual: (W, T, n) [rad or m]; noise: (n,) [rad or m]."""
    off = np.concatenate([point.q0 - windows.q0, point.v0 - windows.v0], 1)
    return reduced(slopes.by_value / noise, residual / noise, state_slopes(slopes.by_state, noise), off)


class Differences(NamedTuple):
    """Values of the base, of P forward and P backward points."""

    values: Array  # (C, P) [SERVO_UNITS]
    sizes: Array  # (P, 2) [SERVO_UNITS] of the forward and backward steps; of a kp relative, with its joint's scale


def nearby(where: Coordinates, values: Array, wide: float, central: bool) -> Differences:
    """Points of central or forward differences; `wide` multiplies the steps; values: (P,) [SERVO_UNITS]."""
    steps = wide * where.differences(values)
    forward, backward, size = [], [], np.empty((len(values), 2))
    for i in range(len(values)):
        one = np.zeros(len(values))
        if scale := where.scaled(i):
            one[scale] = wide * DIFFERENCE * values[scale]
            size[i] = wide * DIFFERENCE
        else:
            one[i] = steps[i]
            size[i] = steps[i], steps[i]
            if values[i] - steps[i] < 0 and np.isfinite(where.slots[i].kind.low):
                size[i, 1] = values[i]
        forward.append(values + one)
        backward.append(values - one * size[i, 1] / size[i, 0])
    if not central:
        size[:, 1] = 0.0
    return Differences(np.array([values, *forward, *(backward if central else ())]), size)


def derivatives(positions: Array, where: Coordinates, differences: Differences) -> Array:
    """Derivatives (P, ...) of positions (C, ...) [rad or m] at nearby points by each value alone."""
    values, size, count = differences.values[0], differences.sizes, len(where.slots)
    behind = positions[1 + count : 1 + 2 * count] if size[:, 1].any() else positions[:1]
    slope = (positions[1 : 1 + count] - behind) / size.sum(1).reshape(-1, *(1,) * (positions.ndim - 1))
    out = slope.copy()
    for i in range(count):
        if scale := where.scaled(i):  # slope[i] is along the common scale of its joint
            for k in scale:
                if k != i:
                    out[i] -= values[k] * slope[k]
            out[i] /= values[i]
    return np.asarray(out)


def reduced(by_value: Array, residual: Array, states: StateSlopes, off: Array | None = None) -> Normal:
    """Normal equations of windows whose initial states are eliminated (Schur).

    by_value: (P, W, T, n) [1/SERVO_UNITS] derivatives and residual: (W, T, n) [1], both over the noise.
    off: (W, 2n) [rad and rad/s] initial states about the centre of their prior; default: there.
    """
    a = np.moveaxis(by_value.reshape(len(by_value), len(residual), residual[0].size), 0, 2)
    z = residual.reshape(len(residual), -1, 1)
    b, inverse = states
    state = (np.swapaxes(b, 1, 2) @ z)[:, :, 0]
    if off is not None:
        state = state + _state_prior(residual.shape[-1]) * off
    across = np.swapaxes(a, 1, 2) @ b
    each = np.swapaxes(a, 1, 2) @ a - across @ inverse @ np.swapaxes(across, 1, 2)
    scores = (np.swapaxes(a, 1, 2) @ z)[:, :, 0] - np.einsum("wps,wsu,wu->wp", across, inverse, state)
    return Normal(each, scores, across, inverse, state)


def _state_prior(n: int) -> Array:
    """Precision (2n,) of the prior of an initial state."""
    return np.repeat([STATE[0] ** -2.0, STATE[1] ** -2.0], n)


def covariance(information: Array, scores: Array, prior: Array | None = None) -> Array:
    """Covariance (P, P) in the units of the values; infinite variance without influence.

    information: (P, P) of white residuals [inverse products of SERVO_UNITS].
    scores: (W, P) gradient of each window at the optimum, in time order [1/SERVO_UNITS].
    prior: (P, P) precision [inverse products of SERVO_UNITS]; default: none.
    """
    prior = np.zeros_like(information) if prior is None else prior
    information = information + prior
    inverse, windows = _inverse(information), len(scores)
    seen = np.diag(inverse) > 0
    out, count = np.diag(np.where(seen, 0.0, np.inf)), int(seen.sum())
    if not count:
        return out
    factor = windows / max(windows - WINDOWS_PER_NUMBER * count, windows / 4)
    meat = [factor * _meat(scores, k) for k in (0, min(NEIGHBOURS, windows // (2 * NEIGHBOURS)))]
    robust = [inverse @ (one + prior) @ inverse for one in meat]
    widest = np.max([np.diag(one) for one in (*robust, inverse)], axis=0)
    wider = np.sqrt(widest / np.maximum(np.diag(robust[0]), np.maximum(MIN_ROBUST_VARIANCE * widest, 1e-300)))
    return np.asarray(out + robust[0] * np.outer(wider, wider))


class Certainty(NamedTuple):
    """Covariance and spread of P numbers."""

    covariance: Array  # (P, P) [products of SERVO_UNITS]
    spread: Array  # (P,) [SERVO_UNITS] standard deviation between recordings, 0 where they agree


def certainty(at: Normal, recording: Indices, prior: Array, ratios: Array) -> Certainty:
    """Certainty about an optimum, with what windows that are not independent and unlike recordings leave open.

    Each recording moves the numbers by a step about the common optimum. Blocks of its windows, and recordings, are
    compared along the ratios to kp and the common scales, since positions identify ratios.

    Args:
        at: normal equations at the optimum.
        recording: (W,) number of the recording of each window.
        prior: (P, P) precision [inverse products of SERVO_UNITS].
        ratios: (P, P) derivatives of the values by these ratios and scales [SERVO_UNITS over theirs].
    """
    own, inner = [np.flatnonzero(recording == k) for k in np.unique(recording)], ratios.T @ prior @ ratios
    each, scores = ratios.T @ at.each @ ratios, at.scores @ ratios
    parts, moved = np.array([each[some].sum(0) for some in own]), scores.copy()
    steps = np.array([-_inverse(x + inner) @ scores[some].sum(0) for x, some in zip(parts, own, strict=True)])
    for step, some in zip(steps if len(own) > 1 else (), own, strict=False):
        moved[some] += each[some] @ step
    alike, whole, wider = covariance(parts.sum(0), scores, inner), _inverse(parts.sum(0) + inner), np.ones(len(inner))
    known = np.maximum(np.diag(covariance(parts.sum(0), moved, inner)), np.diag(whole))
    blocks = [some for windows in own for some in np.array_split(windows, BLOCKS)]
    if len(moved) >= max(len(blocks), len(inner)):
        x, right = (np.array([one[some].sum(0) for some in blocks]) for one in (each, moved))
        ratio, free = jackknife_variance(x, right, inner, len(inner)) / known, len(blocks) - len(own)
        few = (t.ppf(0.975, len(blocks) - 1) / TWO_SIDED) ** 2
        wider = np.where(chi2.sf(free * ratio / few, free) < DEPENDENT_PROBABILITY, np.maximum(ratio, 1.0), 1.0)
    lost = WINDOWS_PER_NUMBER * len(inner)  # windows of each recording
    alone = np.array([np.diag(_inverse(x + inner)) for x in parts]) / np.maximum(np.diag(whole), 1e-300)
    alone = np.where(alone > 0, alone, np.inf) * known * wider * max(len(moved) - lost, len(moved) / 4) / len(moved)
    rest = np.array([max(len(some) - lost, 0.0) / len(some) for some in own])
    variances = np.where(rest[:, None] >= LEAST_REST, alone / np.maximum(rest, LEAST_REST)[:, None], np.inf)
    spread = spread_between(steps, variances)
    unseen = np.isinf(known)
    alike[unseen, unseen] = 0.0
    alike = alike * np.sqrt(np.outer(wider, wider)) + spread_covariance(spread, parts, whole)
    found = ratios @ alike @ ratios.T
    found[unseen, unseen] = np.inf
    return Certainty(found, spread * np.diag(ratios))


def _meat(scores: Array, lags: int) -> Array:
    """Sum (P, P) of products of the gradients of windows up to `lags` apart, with falling weights."""
    out = scores.T @ scores
    for lag in range(1, lags + 1):
        product = scores[lag:].T @ scores[:-lag]
        out = out + (1 - lag / (lags + 1)) * (product + product.T)
    return np.asarray(out)


def _inverse(matrix: Array) -> Array:
    """Inverse of an information (P, P) relative to its diagonal; zero of numbers without influence."""
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > MIN_INFLUENCE * size.max(initial=0.0))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    least = MIN_EIGENVALUE * values.max(initial=1.0)
    return np.asarray((vectors / np.maximum(values, least)) @ vectors.T * np.outer(scale, scale))


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
