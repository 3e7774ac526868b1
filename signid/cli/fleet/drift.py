"""A parameter over the sessions of one robot: does it drift, or is it noise?"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr, ndtri, stdtr, stdtrit

from ...types import Array, Frozen
from .summary import Number

FEWEST = 3  # sessions at different times
LEVEL = 0.05  # chance of a false drift among all numbers of a fleet


@dataclass(frozen=True, eq=False)
class Drift(Frozen):
    """A number at k instants, and the straight line through it."""

    robot: str
    what: str
    unit: str
    day: Array  # (k,) [d] since 1970
    value: Array  # (k,) [unit]
    std: Array  # (k,) [unit]
    slope: float  # [unit/d]
    half: float  # [unit/d] half width of its 95 % interval
    middle: float  # [unit] the line at the mean day, days weighted as values are
    mean_day: float  # [d]
    chance: float  # of a slope as steep without any drift
    beyond: bool = False  # whether it is beyond noise, among all numbers that were looked at

    @property
    def change(self) -> float:
        """From the first session to the last, along the line [unit]."""
        return self.slope * float(np.ptp(self.day))


def find_drifts(robots: Iterable[tuple[str, Sequence[tuple[float, Sequence[Number]]]]]) -> tuple[Drift, ...]:
    """The line through every number that three sessions or more of a robot tell; those beyond noise first.

    Weights are inverse variances. Where the values scatter more about the line than their standard deviations say, the
    interval is widened by that much, with Student's t for the few sessions. A drift counts where the chance of it times
    how many numbers were looked at is below 5 % (Holm).

    Args:
        robots: name of each, and its sessions: day [d] and numbers.

    Source: Birge, Physical Review 40, 1932 (scatter); Holm, Scandinavian J. Statistics 6, 1979 (many at once).
    """
    lines = [line for name, sessions in robots for line in _lines(name, sessions)]
    lines.sort(key=lambda line: (line.chance, line.robot, line.what))
    found, still = [], True
    for k, line in enumerate(lines):
        still = still and line.chance * (len(lines) - k) < LEVEL
        found.append(replace(line, beyond=still))
    return tuple(found)


def _lines(robot: str, sessions: Sequence[tuple[float, Sequence[Number]]]) -> list[Drift]:
    points: dict[tuple[str, str], list[tuple[float, Number]]] = {}
    for day, numbers in sorted(sessions, key=lambda session: session[0]):
        for number in numbers:
            points.setdefault((number.what, number.unit), []).append((day, number))
    lines = []
    for (what, unit), told in points.items():
        if len({day for day, _ in told}) >= FEWEST:
            table = np.array([[day, number.value, number.std] for day, number in told])
            lines.append(_line(robot, what, unit, *table.T))
    return lines


def _line(robot: str, what: str, unit: str, day: Array, value: Array, std: Array) -> Drift:
    """Weighted least squares through k > 2 points."""
    weight = (std.min() / std) ** 2
    mean_day, middle = (float(weight @ x / weight.sum()) for x in (day, value))
    lever = weight @ (day - mean_day) ** 2
    slope = float(weight @ ((day - mean_day) * (value - middle)) / lever)
    own = float(std.min() / np.sqrt(lever))
    rest, left = value - middle - slope * (day - mean_day), len(day) - 2
    scatter = own * float(np.sqrt(weight @ rest**2 / left)) / float(std.min())
    half = max(float(ndtri(0.975)) * own, float(stdtrit(left, 0.975)) * scatter)
    chance = max(2 * ndtr(-abs(slope) / own), 2 * stdtr(left, -abs(slope) / scatter) if scatter else 0.0)
    return Drift(robot, what, unit, day, value, std, slope, half, middle, mean_day, float(chance))
