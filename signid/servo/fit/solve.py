"""Gauss-Newton with Levenberg damping along ratios and common scales, and with bounds; other starts of a fit.

The cost may have several valleys: along scales of torque that the data hardly set, and at limits that are not reached.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...types import Array
from .coordinates import Coordinates
from .normal import FitPoint, Normal, cost, covariance, normal, residuals, settle, slopes_at
from .windows import FitWindows

CENTRAL_GAIN = 0.05  # relative gain of the cost below which differences become central
WIDENING_GAIN, TOLERANCE = 1e-3, 1e-5  # relative gain of the cost below which differences widen, or the fit ends
WIDER = (1.0, 4.0)  # differences that are tried one after another
FIRST_DAMPING, MIN_DAMPING, DAMPING_RISE, DAMPING_FALL, DAMPING_TRIALS = 1e-2, 1e-7, 6.0, 0.1, 6  # [1] factors
SMALLEST_NOISE = 1e-5  # [rad or m]
WEAK = 0.2  # standard deviation of kp over kp from which other scales are tried
FACTORS = (10.0, 0.1)
LIMITS = (0.6, 0.35)  # limits of torque over stiffness at the start times the largest error
SEEN = 1.0  # squared influence of a relative change of a limit, over the noise, below which it is not reached
SCANNED = 2  # joints of a group that are tried
BRIEF = 6  # steps from another scale
VALLEY = 0.02  # gain of the logarithm of the squared residual that is worth another valley


class Solved(NamedTuple):
    """End of a fit."""

    point: FitPoint
    residual: Array  # (W, T, n) [rad or m] at the point
    noise: Array  # (n,) [rad or m]
    steps: int

    @property
    def badness(self) -> float:
        """Sum over joints of the logarithm of the squared residual, to compare ends of one fit."""
        return float(2 * np.log(self.noise).sum())


def solve(windows: FitWindows, where: Coordinates, point: FitPoint, iterations: int, coarse: bool = False) -> Solved:
    """Minimise the weighted output error from a point; `coarse`: until a step gains little.

    Dry friction makes the cost rough: where no step along the model of small differences brings it down, larger
    differences see over the roughness. Derivatives serve further steps, which count for nothing, as long as these gain
    enough, and not so much that the derivatives must be others.

    iterations: most times that derivatives are computed.
    """
    damping, steps, wide, central = FIRST_DAMPING, 0, 0, False
    last, slopes = 1 if coarse else len(WIDER), None
    residual = residuals(windows, where, point)
    noise = noise_of(residual[windows.inside], robust=True)
    left_over = iterations
    while left_over > 0:
        known = slopes is not None
        left_over -= not known
        slopes = slopes or slopes_at(windows, where, point, WIDER[wide], central)
        here = normal(windows, slopes, residual, point, noise)
        now = cost(windows, residual, point, noise) + where.prior_cost(point.values)
        then, tried = np.inf, damping
        for _ in range(1 if known else DAMPING_TRIALS):
            values = damped(where, here, point.values, tried)
            if np.isfinite(values).all():
                state = here.state + np.einsum("wps,p->ws", here.across, values - point.values)
                states = -np.einsum("wsu,wu->ws", here.inverse, state)
                new, left = settle(windows, where, point, (values, states), noise)
                then = cost(windows, left, new, noise) + where.prior_cost(values)
            if np.isfinite(then) and then < now:
                break
            tried *= DAMPING_RISE
        small = not then < now * (1 - (WIDENING_GAIN if coarse or wide + 1 < len(WIDER) else TOLERANCE))
        far = then < now * (1 - CENTRAL_GAIN)
        if then < now:
            point, residual, steps = new, left, steps + 1
            damping = max(tried * DAMPING_FALL, MIN_DAMPING)
            noise = noise_of(residual[windows.inside])
        elif not known:
            damping = tried
        slopes = None if small or far else slopes
        if small and not known:
            wide, damping = wide + (central or coarse), min(damping, FIRST_DAMPING)
        if wide == last:
            break
        central = central or not (far or coarse)
    return Solved(point, residual, noise, steps)


def noise_of(residual: Array, robust: bool = False) -> Array:
    """Size (n,) of the residual (M, n) of each joint [rad or m]; `robust`: by its median."""
    middle = np.median(residual**2, axis=0) / 0.455 if robust else np.mean(residual**2, axis=0)
    return np.asarray(np.maximum(np.sqrt(middle), SMALLEST_NOISE))


def damped(where: Coordinates, here: Normal, values: Array, damping: float) -> Array:
    """Values after a Gauss-Newton step within bounds, damped along ratios and scales; values: (P,) [SERVO_UNITS]."""
    slope, x = where.slope(values), where.x(values)
    precision, off = where.prior(values)
    information = here.information * np.outer(slope, slope) + np.diag(precision)
    gradient = here.scores.sum(0) * slope + precision * off
    ratios = where.ratios(values)
    size = np.diag(ratios.T @ information @ ratios) + 1e-12
    back = np.linalg.inv(ratios)
    low, high, longest = np.array([(s.low, s.high, s.longest) for s in where.slots]).reshape(-1, 3).T
    room = low - x, np.maximum(high - x, 0.0)
    dx = _bounded(information + damping * back.T @ (size[:, None] * back), gradient, room, longest)
    return where.values_at(np.clip(x + dx, low, np.maximum(high, x)))


def _bounded(matrix: Array, gradient: Array, room: tuple[Array, Array], most: Array) -> Array:
    """Step (P,) of a quadratic model; coordinates that would leave their bounds stay there.

    room: (P,) each, the least and the largest step.
    """
    step, free = np.zeros(len(gradient)), np.ones(len(gradient), dtype=bool)
    for _ in range(len(gradient)):
        step[~free] = np.clip(step, *room)[~free]
        rest = gradient + matrix[:, ~free] @ step[~free]
        step[free] = -np.linalg.solve(matrix[np.ix_(free, free)], rest[free])
        out = free & ((step < room[0]) | (step > room[1]))
        if not out.any() or (free & ~out).sum() == 0:
            break
        free &= ~out
    return np.clip(step, -most, most)


def scan(windows: FitWindows, where: Coordinates, solved: Solved, iterations: int) -> Solved:
    """Best end of a fit over the scales of its weak joints and the limits that it does not reach, one by one."""
    slopes = slopes_at(windows, where, solved.point)
    best, at = solved, normal(windows, slopes, solved.residual, solved.point, solved.noise)
    for i in (*untouched(where, solved, at), *weakest(where, solved, at)):
        ends = [best]
        for factor in FACTORS if where.slots[i].number == "kp" else LIMITS:
            values = best.point.values.copy()
            if where.slots[i].number == "kp":
                values[where.scaled(i)] *= factor
            else:
                values[i] = factor * where.slots[i].typical
            ends.append(solve(windows, where, FitPoint(values, best.point.q0, best.point.v0), min(BRIEF, iterations)))
        other = min(ends, key=lambda end: end.badness)
        if other.badness < best.badness - VALLEY:
            best = solve(windows, where, other.point, iterations)
    return best


def weakest(where: Coordinates, solved: Solved, at: Normal) -> list[int]:
    """Slots of the stiffnesses with the widest intervals, if these are wide: at most SCANNED."""
    std = np.sqrt(np.diag(covariance(at.information, at.scores)))
    share = {i: float(std[i] / solved.point.values[i]) for i, slot in enumerate(where.slots) if slot.number == "kp"}
    return sorted((i for i in share if share[i] > WEAK), key=lambda i: -share[i])[:SCANNED]


def untouched(where: Coordinates, solved: Solved, at: Normal) -> list[int]:
    """Slots of the limits of torque without influence, at joints with the largest residuals: at most SCANNED."""
    weight = np.diag(at.information) * solved.point.values**2
    found = [i for i, s in enumerate(where.slots) if s.number == "effort_limit" and weight[i] < SEEN]
    return sorted(found, key=lambda i: -float(solved.noise[where.slots[i].joint]))[:SCANNED]
