"""Fit an even clock with dropped rows to time stamps that carry errors."""

from __future__ import annotations

from collections.abc import Sequence
from heapq import heappush, heapreplace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...types import Array
from .clock import Clock

WINDOW, BLOCK, KNOTS = 512, 256, 16  # [rows] that determine the period; of a phase; [blocks] between changes of rate
FEWEST = 64  # rows that an even clock needs
NEAREST, FARTHEST = 0.7, 1.45  # [median steps] range in which the period is searched
COHERENT = 0.25  # [1] coherence from which dropped rows can be counted; white errors of a quarter of a period: 0.29
LOOSEST = 0.35  # [periods] largest rms error of a stamp; uniform phases have 0.29, one period more has 0.5
WANDER = 0.1  # [periods] largest rms departure of the phase from a slow drift
STEADY = 0.05  # [periods] drift of the phase within a stretch that makes no difference
DRIFT = 1e-3  # [1] largest relative change of rate within a stretch: the tolerance of uniform sampling
DROPPED = 0.5  # largest share of missing rows within a stretch
FEW = 0.5  # [periods] least summed error that a jump next to an end must save
SMALLEST = 1e-3  # [periods] largest error that makes no difference: the tolerance of uniform sampling


class EvenClock(NamedTuple):
    """Times of rows on an even clock, and the errors of their stamps."""

    period: float  # [s]
    times: Array  # (N,) [s]
    jitter: float  # [s] rms error of the stamps
    missing: int  # dropped rows, without gaps


def fit_even(stamps: Array, clock: Clock) -> EvenClock | None:
    """Fit an even clock to the increasing stamps (N,) [s] of a recording; None if they are not of such a clock.

    The period is the one with the most coherent phases of the stamps near the median step. The phase may drift slowly,
    and is free in each part between gaps. Dropped rows are counted: the number of missing rows before each row is the
    nondecreasing sequence of integers nearest to the stamps (L1 isotonic regression), so that a late row is not taken
    as a dropped one. Where errors are too large for coherent phases, no row within a part counts as dropped.

    Source: Bretthorst, Bayesian Spectrum Analysis and Parameter Estimation, 1988 (periodogram of phases); Barlow,
    Bartholomew, Bremner, Brunk, Statistical Inference under Order Restrictions, 1972 (isotonic regression).
    """
    if len(stamps) < FEWEST:
        return None
    x = stamps - stamps[0]
    ends = [0, *(np.flatnonzero(np.diff(x) > clock.gap) + 1).tolist(), len(x)]
    parts = [x[low:high] for low, high in pairwise(ends)]
    longest = max(parts, key=len)
    if len(longest) < FEWEST:
        return None
    period, coherence = _period(longest, clock.period)
    count = _ticks if coherence >= COHERENT else _rows
    first = float(np.polyfit(count(longest, period), longest, 1)[0])
    ticks = [count(part, first) for part in parts]
    period = _rate(parts, ticks)
    fits = [_smooth(part, k, period) for part, k in zip(parts, ticks, strict=True)]
    if any(fit is None for fit in fits):
        return None
    times, cycles = np.concatenate([fit for fit in fits if fit is not None]), sum(float(k[-1]) for k in ticks)
    error, missing = x - times, int(cycles) + len(parts) - len(x)
    jitter = float(np.sqrt(np.mean(error**2)))
    usable = SMALLEST * period < np.abs(error).max() and jitter <= LOOSEST * period and missing <= DROPPED * len(x)
    return EvenClock(period, stamps[0] + times, jitter, missing) if usable and np.all(np.diff(times) > 0) else None


def _period(x: Array, typical: float) -> tuple[float, float]:
    """Period [s] with the most coherent phases of times x (N,) [s], and that coherence [1]."""
    size = min(WINDOW, len(x))
    starts = np.arange(0, len(x) - size + 1, max(1, size // 2))
    best = starts[np.argmin(x[starts + size - 1] - x[starts])]  # the window with the fewest dropped rows
    part = (x[best : best + size] - x[best]) / typical
    step = 1 / (8 * part[-1])
    frequency = np.arange(1 / FARTHEST, 1 / NEAREST, step)
    coherence = np.array([abs(np.exp(2j * np.pi * f * part).mean()) for f in frequency])
    k = int(np.clip(np.argmax(coherence), 1, len(frequency) - 2))
    left, middle, right = coherence[k - 1 : k + 2]
    bend = left - 2 * middle + right
    shift = float(np.clip(0.5 * (left - right) / bend, -1, 1)) if bend < 0 else 0.0
    return typical / (float(frequency[k]) + shift * step), float(middle)


def _rows(x: Array, period: float) -> Array:
    """Ticks (N,) if no row was dropped."""
    return np.arange(len(x), dtype=float)


def _ticks(x: Array, period: float) -> Array:
    """Ticks (N,) of rows at increasing times x (N,) [s], the first of which is 0."""
    cycles = x / period
    starts = _blocks(len(x))
    sizes = np.diff([*starts, len(x)])
    turn = np.exp(2j * np.pi * cycles)
    phase = np.unwrap(np.angle(np.add.reduceat(turn, starts))) / (2 * np.pi)
    centre = np.add.reduceat(cycles, starts) / sizes
    rows = np.arange(len(x))
    near = cycles - np.interp(cycles, centre, phase) - rows
    missing = _ascending(np.rint(near - np.rint(near[0])).astype(int))
    rms = float(np.sqrt(np.mean((near - np.rint(near)) ** 2)))
    for end in (slice(None), slice(None, None, -1)):  # a few rows at an end are no evidence against their errors
        m, r = missing[end], (near - np.rint(near[0]))[end]
        run = int(np.argmax(m != m[0]))
        if run and np.sum(np.abs(r[:run] - m[run]) - np.abs(r[:run] - m[0])) < FEW + 2 * rms:
            m[:run] = m[run]
    return np.asarray(rows + missing - missing[0], float)


def _ascending(values: NDArray[np.int_]) -> NDArray[np.int_]:
    """Nondecreasing integers (N,) with the smallest sum of absolute differences from the values (N,)."""
    highest, lowest = np.maximum.accumulate(values), np.minimum.accumulate(values[::-1])[::-1]
    if np.array_equal(highest, lowest):
        return values
    heap: list[int] = []
    found = np.empty_like(values)
    for i, value in enumerate(values.tolist()):
        heappush(heap, -value)
        if -heap[0] > value:
            heapreplace(heap, -value)
        found[i] = -heap[0]
    return np.minimum.accumulate(found[::-1])[::-1]


def _rate(parts: Sequence[Array], ticks: Sequence[Array]) -> float:
    """Common slope of times (N,) [s] over ticks (N,) of parts with offsets of their own, by least squares."""
    centred = [(x - x.mean(), k - k.mean()) for x, k in zip(parts, ticks, strict=True)]
    return sum(float(x @ k) for x, k in centred) / sum(float(k @ k) for _, k in centred)


def _smooth(x: Array, ticks: Array, period: float) -> Array | None:
    """Times (N,) [s] of a clock of slowly drifting rate next to the stamps x (N,) [s]; None if they wander off it."""
    rest = x - period * ticks
    starts = _blocks(len(x))
    sizes = np.diff([*starts, len(x)])
    mean, centre = np.add.reduceat(rest, starts) / sizes, np.add.reduceat(ticks, starts) / sizes
    steady = float(rest.mean())
    if len(starts) == 1:
        return np.asarray(period * ticks + steady)
    pieces = max(1, len(starts) // KNOTS)
    knots = np.interp(np.linspace(0, len(starts) - 1, pieces + 1), np.arange(len(starts)), centre)
    hats = np.column_stack([np.interp(centre, knots, unit) for unit in np.eye(pieces + 1)])
    level = np.linalg.lstsq(hats, mean, rcond=None)[0]
    if np.abs(hats @ level - steady).max() < STEADY * period:
        level[:] = steady
    wander = np.sqrt(np.mean((mean - hats @ level) ** 2))
    if wander > WANDER * period or np.any(np.abs(np.diff(level) / np.diff(knots)) > DRIFT * period):
        return None
    outside = np.clip(ticks, knots[0], knots[-1])
    slope = np.diff(level)[[0, -1]] / np.diff(knots)[[0, -1]]
    beyond = np.where(ticks < knots[0], slope[0], slope[1]) * (ticks - outside)
    return np.asarray(period * ticks + np.interp(outside, knots, level) + beyond)


def _blocks(rows: int) -> NDArray[np.int_]:
    """First rows of blocks of equal lengths."""
    return np.linspace(0, rows, max(1, rows // BLOCK), endpoint=False).astype(int)
