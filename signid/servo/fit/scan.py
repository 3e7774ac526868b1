"""Other starts where the cost may have several valleys: weak scales of torque, and limits that are never reached."""

from __future__ import annotations

import numpy as np

from .coordinates import Coordinates
from .intervals import covariance
from .normal import FitPoint, Normal, normal
from .solve import Solved, solve
from .windows import FitWindows

WEAK = 0.2  # standard deviation of kp over kp from which other scales are tried
FACTORS = (10.0, 0.1)
LIMITS = (0.6, 0.35)  # limits of torque over stiffness at the start times the largest error
SEEN = 1.0  # squared influence of a relative change of a limit, over the noise, below which it is not reached
MOST = 2  # joints of a group that are tried
BRIEF = 6  # steps from another scale
BETTER = 0.02  # gain of the logarithm of the squared residual that is worth another valley


def scan(windows: FitWindows, where: Coordinates, solved: Solved, iterations: int) -> Solved:
    """Best end of a fit over the scales of its weak joints and the limits that it does not reach, one by one."""
    best, at = solved, normal(windows, where, solved.point, solved.noise)
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
        if other.badness < best.badness - BETTER:
            best = solve(windows, where, other.point, iterations)
    return best


def weakest(where: Coordinates, solved: Solved, at: Normal) -> list[int]:
    """Slots of the stiffnesses with the widest intervals, if these are wide: at most MOST."""
    std = np.sqrt(np.diag(covariance(at.information, at.scores)))
    share = {
        i: float(std[i] / solved.point.values[i])
        for i, slot in enumerate(where.slots)
        if slot.number == "kp" and not slot.shared
    }
    return sorted((i for i in share if share[i] > WEAK), key=lambda i: -share[i])[:MOST]


def untouched(where: Coordinates, solved: Solved, at: Normal) -> list[int]:
    """Slots of the limits of torque without influence, at joints with the largest residuals: at most MOST."""
    weight = np.diag(at.information) * solved.point.values**2
    found = [i for i, s in enumerate(where.slots) if s.number == "effort_limit" and not s.shared and weight[i] < SEEN]
    return sorted(found, key=lambda i: -float(solved.noise[where.slots[i].joint]))[:MOST]
