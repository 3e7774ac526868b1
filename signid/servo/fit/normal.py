"""Normal equations of the output error over windows; initial states of the windows are eliminated (Schur)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...types import Array
from .coordinates import DIFFERENCE, Coordinates
from .shots import MOST_VALUES, Shots, shoot

STATE = (2e-3, 0.3)  # prior of an initial state about the smoothed one: [rad or m], [rad/s or m/s]
NUDGE = (1e-4, 1e-2)  # differences of initial states
SHARES = (1.0, 0.3, 0.0)  # of the step of a window's state that are tried


@dataclass(frozen=True, eq=False)
class FitPoint:
    """Where a fit stands: values (P,), and initial states (W, n) of the windows of each grid."""

    values: Array  # (P,) [SERVO_UNITS]
    q0: tuple[Array, ...]  # (W, n) [rad or m] of each grid
    v0: tuple[Array, ...]  # (W, n) [rad/s or m/s] of each grid


@dataclass(frozen=True, eq=False)
class Normal:
    """Quadratic model of half the cost about a point, for steps of the values (in SERVO_UNITS)."""

    residual: tuple[Array, ...]  # (W, rows + 1, n) [rad or m] of each grid
    information: Array  # (P, P) [inverse products of SERVO_UNITS]
    scores: Array  # (W, P) [1/SERVO_UNITS] gradient of each window, states eliminated
    across: Array  # (W, P, 2n) [inverse products] values and states
    inverse: Array  # (W, 2n, 2n) [products of rad, rad/s] of the states' information
    state: Array  # (W, 2n) [1/rad, s/rad] gradient of the states


def residuals(shots: Sequence[Shots], where: Coordinates, point: FitPoint) -> tuple[Array, ...]:
    """Simulated minus measured positions (W, rows + 1, n) of each grid."""
    copies = where.table(point.values[None])
    return tuple(
        shoot(s, where.servos, copies, q0[None], v0[None])[0][0] - s.measured
        for s, q0, v0 in zip(shots, point.q0, point.v0, strict=True)
    )


def settle(
    shots: Sequence[Shots], where: Coordinates, point: FitPoint, values: Array, states: Array, noise: Array
) -> tuple[FitPoint, tuple[Array, ...]]:
    """New values, and for each window the share of the step of its state that fits best; with residuals.

    values: (P,) [SERVO_UNITS]; noise: (n,) [rad or m].
    states: (W, 2n) [rad and rad/s, or m and m/s].
    """
    copies = where.table(np.repeat(values[None], len(SHARES), 0))
    q: list[Array] = []
    v: list[Array] = []
    out: list[Array] = []
    k = 0
    for s, q0, v0 in zip(shots, point.q0, point.v0, strict=True):
        step, n = states[k : k + len(q0)], len(s.joints)
        k += len(q0)
        qs = np.array([q0 + share * step[:, :n] for share in SHARES])
        vs = np.array([v0 + share * step[:, n:] for share in SHARES])
        residual = shoot(s, where.servos, copies, qs, vs)[0] - s.measured
        best = np.argmin(_costs(s, residual, qs, vs, noise), axis=0), np.arange(len(q0))
        q, v, out = [*q, qs[best]], [*v, vs[best]], [*out, residual[best]]
    return FitPoint(values, tuple(q), tuple(v)), tuple(out)


def cost(shots: Sequence[Shots], residual: Sequence[Array], point: FitPoint, noise: Array) -> float:
    """Weighted squares of residuals and of the states against their prior.

    residual: (W, rows + 1, n) of each grid [rad or m]; noise: (n,) [rad or m].
    """
    each = zip(shots, residual, point.q0, point.v0, strict=True)
    return float(sum(_costs(s, r, q0, v0, noise).sum() for s, r, q0, v0 in each))


def _costs(s: Shots, residual: Array, q0: Array, v0: Array, noise: Array) -> Array:
    """Cost (..., W) of each window."""
    squares = np.sum((residual / noise) ** 2, axis=(-1, -2))
    prior = np.sum(((q0 - s.q0) / STATE[0]) ** 2 + ((v0 - s.v0) / STATE[1]) ** 2, axis=-1)
    return np.asarray(np.where(np.isfinite(squares), squares, np.inf) + prior)


def normal(
    shots: Sequence[Shots], where: Coordinates, point: FitPoint, noise: Array, wide: float = 1.0, central: bool = True
) -> Normal:
    """Normal equations at a point; `wide` multiplies the differences, central or forward; noise: (n,) [rad or m]."""
    copies, back = _copies(where, point.values, wide, central)
    parts = []
    for s, q0, v0 in zip(shots, point.q0, point.v0, strict=True):
        n = len(s.joints)
        most = max(MOST_VALUES // ((len(copies) + 2 * n) * (s.rows + 1) * n), 1)
        for k in range(0, len(s.starts), most):
            cut = slice(k, k + most)
            some = replace(s, starts=s.starts[cut], q0=s.q0[cut], v0=s.v0[cut])
            parts.append(_windows(some, where, copies, back, point.values, q0[cut], v0[cut], noise))
    joined = [np.concatenate([part[i] for part in parts]) for i in range(2, 6)]
    information = sum((part[1] for part in parts), np.zeros((len(where.slots),) * 2))
    return Normal(tuple(_by_grid(shots, [part[0] for part in parts])), information, *joined)


def _by_grid(shots: Sequence[Shots], parts: list[Array]) -> list[Array]:
    out, rest = [], list(parts)
    for s in shots:
        own = [rest.pop(0)]
        while sum(map(len, own)) < len(s.starts):
            own.append(rest.pop(0))
        out.append(np.concatenate(own))
    return out


def _copies(where: Coordinates, values: Array, wide: float, central: bool) -> tuple[Array, Array]:
    """Numbers of the base, of P forward and P backward points; (P, 2) signed steps of the forward and backward ones."""
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
            if values[i] - steps[i] < 0 and where.slots[i].number != "torque_offset":
                size[i, 1] = values[i]
        forward.append(values + one)
        backward.append(values - one * size[i, 1] / size[i, 0])
    if not central:
        size[:, 1] = 0.0
    return where.table(np.array([values, *forward, *(backward if central else ())])), size


def _windows(
    s: Shots, where: Coordinates, copies: Array, size: Array, values: Array, q0: Array, v0: Array, noise: Array
) -> tuple[Array, ...]:
    """Residual, information, scores, across, inverse and state of some windows of one grid."""
    n, count = len(s.joints), len(values)
    c = len(copies) + 2 * n
    table = np.concatenate([copies, np.repeat(copies[:1], 2 * n, 0)])
    starts = np.repeat(q0[None], c, 0), np.repeat(v0[None], c, 0)
    for k in range(2):
        for j in range(n):
            starts[k][len(copies) + k * n + j, :, j] += NUDGE[k]
    out = shoot(s, where.servos, table, *starts)[0]
    residual = out[0] - s.measured
    windows = len(residual)
    behind = out[1 + count : 1 + 2 * count] if size[:, 1].any() else out[:1]
    slope = (out[1 : 1 + count] - behind) / size.sum(1)[:, None, None, None]
    slope = _single(slope, where, values)
    by_state = (out[len(copies) :] - out[0]) / np.repeat(NUDGE, n)[:, None, None, None]
    a, b = (np.moveaxis((x / noise).reshape(len(x), windows, -1), 0, 2) for x in (slope, by_state))
    z = (residual / noise).reshape(windows, -1, 1)
    prior = np.repeat([STATE[0] ** -2.0, STATE[1] ** -2.0], n)
    state = (np.swapaxes(b, 1, 2) @ z)[:, :, 0] + prior * np.concatenate([q0 - s.q0, v0 - s.v0], 1)
    across = np.swapaxes(a, 1, 2) @ b
    inverse = np.linalg.inv(np.swapaxes(b, 1, 2) @ b + np.diag(prior))
    whole = (np.swapaxes(a, 1, 2) @ a - across @ inverse @ np.swapaxes(across, 1, 2)).sum(0)
    scores = (np.swapaxes(a, 1, 2) @ z)[:, :, 0] - np.einsum("wps,wsu,wu->wp", across, inverse, state)
    return residual, whole, scores, across, inverse, state


def _single(slope: Array, where: Coordinates, values: Array) -> Array:
    """Derivatives by each value alone, from those where kp stands for the common scale of its joint."""
    out = slope.copy()
    for i in range(len(values)):
        if scale := where.scaled(i):
            for k in scale:
                if k != i:
                    out[i] -= values[k] * slope[k]
            out[i] /= values[i]
    return out
