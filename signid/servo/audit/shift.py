"""Shift of the command in time at which the position of a joint resembles it most."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...types import Array
from .tracks import Grid

LONGEST, FARTHEST = 0.6, 2.5  # [s] largest shift of a drive, and of columns that are from different rows
SHARE = 0.2  # [1] largest shift over the duration of the longest part
CERTAIN = 0.95  # correlation beyond LONGEST; healthy logs with dry friction have it as well
BETTER = 0.5  # 1 - |correlation| beyond LONGEST over that within
FRICTION = 0.3  # variance left beyond LONGEST over that of a drive with dry friction; healthy logs: above .42
DELAYS = np.linspace(0, 0.3, 4)  # [s] of such a drive
AGAINST = 0.9  # weight of correlations of motion against the command: periodic motion has both signs
NEAREST = 0.98  # correlation of a peak over the largest, from which on the smallest shift is chosen


class Shift(NamedTuple):
    """Best shift of a command; NaN where none was found."""

    seconds: float  # [s] positive: the position is later
    correlation: float  # [1] with its sign
    scale: float  # [1] motion per command


def best_shift(grids: Sequence[Grid]) -> Shift:
    """Shift of the largest correlation; beyond LONGEST only if neither one within it nor dry friction is near."""
    near = _best(grids, LONGEST)
    most = min(FARTHEST, SHARE * max(len(grid.q) * grid.period for grid in grids))
    if most <= LONGEST or (near.correlation > CERTAIN and np.isfinite(near.seconds)):
        return near
    rows = round(most / grids[0].period)
    inner = [grid for grid in grids if len(grid.q) > 2 * rows + 2]
    far = _best(inner, most, against=0.0, known=True)
    if not abs(far.seconds) > LONGEST - 2 * grids[0].period or not far.correlation > CERTAIN:  # NaN: none was found
        return near
    if 1 - far.correlation > BETTER * (1 - abs(near.correlation)):
        return near
    rest = 1 - far.correlation**2
    return near if far.seconds > 0 and rest > FRICTION * _rest_of_friction(inner, rows) else far


def _best(grids: Sequence[Grid], longest: float, against: float = AGAINST, known: bool = False) -> Shift:
    """Best shift up to `longest` [s].

    against: weight of motion against the command; known: leave out rows whose shifted command is not recorded.
    """
    from scipy.signal import correlate  # slow import

    period = grids[0].period
    most = max(1, round(longest / period))
    covariance, command_power, power = (np.zeros(2 * most + 1) for _ in range(3))
    for grid in grids:
        inner = grid.q[most : len(grid.q) - most] if known else grid.q
        inner = inner - inner.mean()
        level = grid.command.mean()
        padded = grid.command - level if known else np.pad(grid.command - level, most, mode="edge")
        covariance += correlate(padded, inner, mode="valid")[::-1]  # the largest lead first
        sums = np.cumsum(np.concatenate([[[0.0, 0.0]], np.column_stack([padded, padded**2])]), axis=0)
        total, squares = (sums[len(inner) :] - sums[: -len(inner)])[::-1].T
        command_power += squares - total**2 / len(inner)
        power += inner @ inner
    size = np.sqrt(np.maximum(command_power, 0.0) * power)
    if not (size > 0).any():
        return Shift(np.nan, np.nan, np.nan)
    r = np.where(size > 1e-12 * size.max(), covariance / np.where(size > 0, size, 1.0), 0.0)
    likely = np.where(r > 0, r, -against * r)
    best = int(np.argmax(likely))
    if best in (0, 2 * most):  # beyond the shifts that were tried
        return Shift(np.nan, float(r[best]), float(covariance[best] / command_power[best]))
    k, part = _peak(likely, most)
    return Shift(float((k + part - most) * period), float(r[k]), float(covariance[k] / command_power[k]))


def _rest_of_friction(grids: Sequence[Grid], edge: int) -> float:
    """Share of the variance [1] that a usual delay leaves with dry friction, which looks late in slow motion.

    edge: rows at both ends of each grid that are left out.
    """
    rest = 1.0
    for delay in DELAYS:
        table = np.concatenate([_with_friction(grid, round(float(delay) / grid.period), edge) for grid in grids])
        x, y = table[:, :2], table[:, 2]
        value = np.linalg.lstsq(x.T @ x, x.T @ y, rcond=1e-12)[0]
        if value[1] <= 0:  # friction holds back
            rest = min(rest, float(np.mean((y - x @ value) ** 2) / np.mean(y**2)))
    return rest


def _with_friction(grid: Grid, delay: int, edge: int) -> Array:
    """Table (N, 3) of the command that is late by rows, its last direction, and the position; means removed."""
    way = np.sign(np.diff(grid.command, prepend=grid.command[0]))
    side = way[np.maximum.accumulate(np.where(way != 0, np.arange(len(way)), 0))]
    stop = len(grid.q) - edge
    rows = slice(edge - delay, stop - delay)
    table = np.column_stack([grid.command[rows], side[rows], grid.q[edge:stop]])
    return np.asarray(table - table.mean(axis=0))


def _peak(size: Array, middle: int) -> tuple[int, float]:
    """Index of the peak that is chosen, and how far its top is from there."""
    tops = np.flatnonzero((size[1:-1] >= size[:-2]) & (size[1:-1] >= size[2:])) + 1
    if not len(tops):
        return int(np.argmax(size)), 0.0
    good = tops[size[tops] >= NEAREST * size[tops].max()]
    k = int(good[np.argmin(np.abs(good - middle))])
    curve = size[k - 1] - 2 * size[k] + size[k + 1]
    return k, float(0.5 * (size[k - 1] - size[k + 1]) / curve) if curve < 0 else 0.0
