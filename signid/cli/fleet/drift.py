"""Drift of parameters over the sessions of one robot."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr, ndtri, stdtr, stdtrit

from ...types import Array, Frozen
from .summary import Number

FEWEST = 3  # minimum number of sessions at different times
LEVEL = 0.05  # family-wise error rate over all parameters of a fleet


@dataclass(frozen=True, eq=False)
class Drift(Frozen):
    """A parameter at k times, and its regression line."""

    robot: str
    what: str
    unit: str
    day: Array  # (k,) [d] since 1970
    value: Array  # (k,) [unit]
    std: Array  # (k,) [unit]
    slope: float  # [unit/d]
    half: float  # [unit/d] half-width of its 95 % interval
    middle: float  # [unit] value of the line at the weighted mean day
    mean_day: float  # [d]
    chance: float  # p-value of the slope under no drift
    beyond: bool = False  # significant after the Holm correction over all parameters

    @property
    def change(self) -> float:
        """Change along the line from the first session to the last [unit]."""
        return self.slope * float(np.ptp(self.day))


def find_drifts(robots: Iterable[tuple[str, Sequence[tuple[float, Sequence[Number]]]]]) -> tuple[Drift, ...]:
    """Fit a line to every parameter that at least three sessions of a robot report; significant drifts first.

    Weights are inverse variances. If the values scatter about the line more than their standard deviations predict, the
    interval is widened by the Birge ratio and Student's t distribution is used. Significance is tested at 5 % with the
    Holm correction for multiple comparisons.

    Args:
        robots: name and sessions of each robot; a session is its day [d] and its parameters.

    Source: Birge, Physical Review 40, 1932 (scatter); Holm, Scandinavian J. Statistics 6, 1979 (multiple tests).
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
    for (what, unit), series in points.items():
        if len({day for day, _ in series}) >= FEWEST:
            table = np.array([[day, number.value, number.std] for day, number in series])
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
