"""Normal equations of the output error over windows; initial states of the windows are eliminated (Schur)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2, t

from ...estimation.repeats import jackknife_variance, spread_between, spread_covariance
from ...types import TWO_SIDED, Array, Indices
from .coordinates import DIFFERENCE, Coordinates
from .windows import MOST_VALUES, FitWindows, shoot

STATE = (2e-3, 0.3)  # prior of an initial state about the smoothed one: [rad or m], [rad/s or m/s]
NUDGE = (1e-4, 1e-2)  # differences of initial states
SHARES = (1.0, 0.3, 0.0)  # of the step of a window's state that are tried
WINDOWS_PER_NUMBER = 0.4  # windows that each fitted number takes from the sandwich
NEIGHBOURS = 3  # windows apart that may be correlated
BLOCKS = 6  # of the windows of a recording: of some seconds, since windows a few apart are correlated (Go2)
LEAST_REST = 0.25  # share of the windows of a recording that its numbers leave, below which it is not judged alone
DEPENDENT = 0.01  # probability by chance of a variance between blocks, below which the windows are not independent
MIN_ROBUST_VARIANCE = 1e-24  # variance over the widest one, below which it counts as this
NOTHING = 1e-12  # influence over the largest one, below which a number is not identifiable
WEAK = 1e-12  # relative eigenvalue of the information below which a direction is not identifiable


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
    most = max(MOST_VALUES // ((len(differences.values) + 2 * n) * (windows.longest + 1) * n), 1)
    parts = []
    for k in range(0, len(windows), most):
        some = slice(k, k + most)
        at = FitPoint(point.values, point.q0[some], point.v0[some])
        parts.append(_slopes(windows.part(some), where, at, differences))
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


def _nudged(point: FitPoint, before: int) -> tuple[Array, Array]:
    """States (C, W, n) of `before` copies at a point and of 2n copies, in each of which one state differs."""
    n = point.q0.shape[1]
    starts = tuple(np.repeat(x[None], before + 2 * n, 0) for x in (point.q0, point.v0))
    for k in range(2):
        for j in range(n):
            starts[k][before + k * n + j, :, j] += NUDGE[k]
    return starts[0], starts[1]


def _slopes(windows: FitWindows, where: Coordinates, point: FitPoint, differences: Differences) -> Slopes:
    """Derivatives of some windows."""
    table, n = differences.values, point.q0.shape[1]
    copies = where.copies(np.concatenate([table, np.repeat(table[:1], 2 * n, 0)]))
    out = shoot(windows, copies, *_nudged(point, len(table)))[0]
    by_state = (out[len(table) :] - out[0]) / np.repeat(NUDGE, n)[:, None, None, None]
    return Slopes(derivatives(out[: len(table)], where, differences), by_state)


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
        wider = np.where(chi2.sf(free * ratio / few, free) < DEPENDENT, np.maximum(ratio, 1.0), 1.0)
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
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > NOTHING * size.max(initial=0.0))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    least = WEAK * values.max(initial=1.0)
    return np.asarray((vectors / np.maximum(values, least)) @ vectors.T * np.outer(scale, scale))
