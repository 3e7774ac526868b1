"""Column of time, period and resolution of its stamps, and an even clock for stamps that carry errors."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from heapq import heappush, heapreplace
from math import log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import RecordingError
from ...types import Array, Frozen, Recording, Table
from ..vocabulary import kinds_of

CHUNK = 65_536  # rows
PIECES = 16  # number of equally spaced chunks that determine the period
GAP, GAP_SECONDS = 3.5, 0.01  # a gap is longer than both [periods], [s]
REPEAT_DISTANCE = 0.02  # distance below which stamps count as repeated [periods]
MAX_STEP, MIN_STEP = 5.0, 1e-5  # [s] plausible range of sampling periods; outside, the unit is not seconds
TYPICAL = 5e-3  # [s] typical sampling period
UNITS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9, "hours": 3600.0, "days": 86400.0}
SHIFTED_START = 1e4  # [s] stamps that begin this far from 0, such as since 1970, are shown from a recording's start
COARSEST = 0.25  # coarsest rounding of stamps in uniform sampling [periods]
WINDOW, BLOCK, KNOTS = 512, 256, 16  # [rows] that determine the period; of a phase; [blocks] between changes of rate
MIN_CLOCK_ROWS = 64  # rows that an even clock needs
MIN_PERIOD_RATIO, MAX_PERIOD_RATIO = 0.7, 1.45  # [median steps] range in which the period is searched
COHERENT = 0.25  # [1] coherence from which dropped rows can be counted; white errors of a quarter of a period: 0.29
LOOSEST = 0.35  # [periods] largest rms error of a stamp; uniform phases have 0.29, one period more has 0.5
WANDER = 0.1  # [periods] largest rms departure of the phase from a slow drift
STEADY = 0.05  # [periods] drift of the phase within a stretch that makes no difference
DRIFT = 1e-3  # [1] largest relative change of rate within a stretch: the tolerance of uniform sampling
DROPPED = 0.5  # largest share of missing rows within a stretch
MIN_JUMP_SAVING = 0.5  # [periods] least summed error that a jump next to an end must save
UNIFORM_ERROR = 1e-3  # [periods] largest error that makes no difference: the tolerance of uniform sampling
DEEPEST = 4.0  # [periods] by which stamps may go back and are repaired
MAX_REPEATED_SHARE = 0.01  # [1] accepted share of rows with a repeated time
MIN_ROUNDED_SHARE = 0.15  # [1] share of such rows above which stamps have too few digits
COPIED = 0.2  # [1] rows with a repeated time move as often as others; below this share they are copies
FEW_TIMES = 8  # rows with both times
DIFFERENT = 0.02  # [periods] difference beyond rounding from which two columns disagree
SHARE = 0.99  # quantile of the differences; 1 - SHARE is the other one
RATE = 2.0  # factor between the rates of two columns beyond which the other one counts something else


class Clock(NamedTuple):
    """Time between samples and resolution of the stamps [s]."""

    period: float  # median
    mean: float  # mean without gaps
    step: float  # resolution of the stamps: 1e-3 if they have at most three decimals

    @property
    def rounding(self) -> float:
        """Rounding error of the difference of two stamps [s]; 0 if the resolution is too coarse."""
        return self.step if self.step <= COARSEST * self.period else 0.0

    @property
    def gap(self) -> float:
        """Longest time step within a stretch [s]."""
        return max(GAP * self.period, GAP_SECONDS) * (1 + 1e-6) + self.rounding

    @property
    def close(self) -> float:
        """Time difference below which stamps count as repeated [s]."""
        return REPEAT_DISTANCE * self.period


def read_clock(recording: Recording, name: str) -> Clock:
    """Determine the clock of a recording from at most a million equally spaced samples.

    Raises:
        RecordingError: single sample, or a time that is empty, infinite, constant, decreasing, or not in seconds.
    """
    column, rows = recording.columns["t"][0], len(recording)
    if rows < 2:
        raise RecordingError(f"{name} is too short: it has a single sample; record at least a few seconds of motion")
    pieces = min(PIECES, -(-rows // CHUNK))
    starts = [round(i * (rows - min(rows, CHUNK)) / max(1, pieces - 1)) for i in range(pieces)]
    times = [recording.table.read((column,), start, start + CHUNK)[:, 0] for start in starts]
    stamps = [piece[~np.isnan(piece)] for piece in times]
    steps = np.concatenate([np.diff(piece) for piece in stamps])
    last = stamps[-1][-64:]
    if not any(len(piece) for piece in stamps):
        raise RecordingError(f"{name}: column {column!r} has no values; expected time in seconds")
    if not all(np.isfinite(piece).all() for piece in stamps):
        raise RecordingError(f"{name}: column {column!r} has infinite times; remove those rows")
    forward = steps[steps > 0]
    if not len(forward):
        fault = "goes back at every row" if (steps < 0).any() else f"does not change from {stamps[0][0]:g}"
        advice = ": sort the rows by time" if (steps < 0).any() else ""
        raise RecordingError(f"{name}: time {fault}; expected seconds that increase from row to row{advice}")
    period = float(np.median(forward))
    if not MIN_STEP <= period <= MAX_STEP:
        unit = likely_unit(period)
        advice = f"it looks like {unit}; convert it to seconds"
        if short := {"milliseconds": "ms", "microseconds": "us", "nanoseconds": "ns", "hours": "h"}.get(unit):
            advice += f', or write [units] t = "{short}", on two lines, into a column map (--columns)'
        raise RecordingError(f"{name}: column {column!r} steps by {period:g}, which cannot be seconds: {advice}")
    mean = float(forward[(forward <= max(GAP * period, GAP_SECONDS)) & (forward > REPEAT_DISTANCE * period)].mean())
    return Clock(period, mean, resolution(last) if len(last) else 0.0)


def time_origin(recording: Recording) -> float:
    """Time stamp from which reports count [s]: the first one if it is far from 0, as in stamps since 1970, else 0."""
    column = recording.columns["t"][0]
    for start in range(0, len(recording), CHUNK):
        stamps = recording.table.read((column,), start, start + CHUNK)[:, 0]
        if (known := stamps[np.isfinite(stamps)]).size:
            return float(known[0]) if abs(known[0]) >= SHIFTED_START else 0.0
    return 0.0


def likely_unit(step: float) -> str:
    """Unit in which a time step is closest to a typical sampling period."""
    return min(UNITS, key=lambda unit: abs(log(step) + log(UNITS[unit] / TYPICAL)))  # a product could be 0


def resolution(stamps: Array) -> float:
    """Resolution of the stamps (N,) [s]: a power of ten if they have a fixed number of decimals."""
    limit = 4 * float(np.spacing(np.abs(stamps).max()))
    for digits in range(10):
        scaled = stamps * 10.0**digits
        if limit * 10**digits < 0.01 and np.all(np.abs(scaled - np.rint(scaled)) < 1e-6 + limit * 10**digits):
            return max(10.0**-digits, limit)
    if np.array_equal(stamps, stamps.astype(np.float32)):
        return float(np.spacing(np.abs(stamps).max().astype(np.float32)))
    return limit


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
    if len(stamps) < MIN_CLOCK_ROWS:
        return None
    x = stamps - stamps[0]
    parts = np.split(x, np.flatnonzero(np.diff(x) > clock.gap) + 1)
    longest = max(parts, key=len)
    if len(longest) < MIN_CLOCK_ROWS:
        return None
    period, coherence = _period(longest, clock.period)
    count = _ticks if coherence >= COHERENT else lambda x, _: np.arange(len(x), dtype=float)
    first = float(np.polyfit(count(longest, period), longest, 1)[0])
    ticks = [count(part, first) for part in parts]
    period = _common_period(parts, ticks)
    fits = [_smooth(part, k, period) for part, k in zip(parts, ticks, strict=True)]
    if any(fit is None for fit in fits):
        return None
    times, cycles = np.concatenate([fit for fit in fits if fit is not None]), sum(float(k[-1]) for k in ticks)
    error, missing = x - times, int(cycles) + len(parts) - len(x)
    jitter = float(np.sqrt(np.mean(error**2)))
    usable = UNIFORM_ERROR * period < np.abs(error).max() and jitter <= LOOSEST * period and missing <= DROPPED * len(x)
    return EvenClock(period, stamps[0] + times, jitter, missing) if usable and np.all(np.diff(times) > 0) else None


class RepairedStamps(NamedTuple):
    """Times of rows whose stamps could not be used as they are."""

    times: Array  # (N,) [s] increasing
    order: NDArray[np.int_] | None  # (N,) rows in the order of time; None: as they are
    note: str


def repair_stamps(stamps: Array, q: Array) -> RepairedStamps | None:
    """Times for stamps (N,) [s] that go back by less than four periods, or have too few digits; None for others.

    Rows keep their order, unless positions q (N, n) [rad or m] are smoother in that of their stamps.
    """
    steps = np.diff(stamps)
    if len(stamps) < MIN_CLOCK_ROWS or not (steps > 0).any():
        return None
    back, again, forward = steps < 0, steps == 0, float(np.median(steps[steps > 0]))
    if back.any():
        depth, period = float((np.maximum.accumulate(stamps) - stamps).max()), float(np.median(steps))
        if not depth < DEEPEST * period:
            return None
        order = np.argsort(stamps, kind="stable")
        fact = f"stamps of time go back by up to {depth * 1e3:.3g} ms in {int(back.sum())} of {len(stamps)} rows"
        if _rough(q[order]) < _rough(q):
            return RepairedStamps(stamps[order], order, f"{fact}: rows are sorted by time")
        clock = Clock(period, period, 0.0)
        even = fit_even(np.sort(stamps), clock)
        spaced = (even.times, even.period) if even else _spaced(np.sort(stamps), clock.gap, DEEPEST * period)
        if spaced is None:
            return None
        how = f"{fact}: rows are kept in their order, {spaced[1] * 1e3:.5g} ms apart"
        return RepairedStamps(spaced[0], None, how)
    moves = np.asarray(np.diff(q, axis=0).any(axis=1))
    if again.mean() <= MIN_ROUNDED_SHARE or moves[again].mean() < COPIED * moves[~again].mean():
        return None  # few rows, or copies of rows
    if (spaced := _spaced(stamps, max(GAP * forward, GAP_SECONDS), forward)) is None:
        return None
    fact = f"stamps of time have too few digits (steps of {forward * 1e3:.3g} ms)"
    how = f"{fact}: rows are spaced evenly by the rate that they imply, {1 / spaced[1]:.4g} Hz"
    return RepairedStamps(spaced[0], None, how)


def _spaced(stamps: Array, gap: float, max_step: float) -> tuple[Array, float] | None:
    """Times (N,) [s] of rows that are evenly spaced between gaps, and their period [s]; None if they are not.

    stamps: (N,) [s] that do not decrease; `max_step` [s]: largest error of one.
    """
    parts = np.split(stamps - stamps[0], np.flatnonzero(np.diff(stamps) > gap) + 1)
    ticks = [np.arange(len(part), dtype=float) for part in parts]
    period = _common_period(parts, ticks) if len(parts) < len(stamps) / MIN_CLOCK_ROWS else 0.0
    fits = [fit for x, k in zip(parts, ticks, strict=True) if period > 0 and (fit := _smooth(x, k, period)) is not None]
    if len(fits) < len(parts) or max(np.abs(x - y).max() for x, y in zip(parts, fits, strict=True)) > max_step:
        return None
    times = stamps[0] + np.concatenate(fits)
    return (times, period) if np.all(np.diff(times) > 0) else None


def _rough(q: Array) -> float:
    """Sum of squared second differences of positions (N, n) [rad or m]."""
    return float(np.nansum(np.diff(q, 2, axis=0) ** 2))


def _period(x: Array, typical: float) -> tuple[float, float]:
    """Period [s] with the most coherent phases of times x (N,) [s], and that coherence [1]."""
    size = min(WINDOW, len(x))
    starts = np.arange(0, len(x) - size + 1, max(1, size // 2))
    best = starts[np.argmin(x[starts + size - 1] - x[starts])]  # the window with the fewest dropped rows
    part = (x[best : best + size] - x[best]) / typical
    step = 1 / (8 * part[-1])
    frequency = np.arange(1 / MAX_PERIOD_RATIO, 1 / MIN_PERIOD_RATIO, step)
    coherence = np.array([abs(np.exp(2j * np.pi * f * part).mean()) for f in frequency])
    k = int(np.clip(np.argmax(coherence), 1, len(frequency) - 2))
    left, middle, right = coherence[k - 1 : k + 2]
    bend = left - 2 * middle + right
    shift = float(np.clip(0.5 * (left - right) / bend, -1, 1)) if bend < 0 else 0.0
    return typical / (float(frequency[k]) + shift * step), float(middle)


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
        if run and np.sum(np.abs(r[:run] - m[run]) - np.abs(r[:run] - m[0])) < MIN_JUMP_SAVING + 2 * rms:
            m[:run] = m[run]
    return np.asarray(rows + missing - missing[0], float)


def _ascending(values: NDArray[np.int_]) -> NDArray[np.int_]:
    """Nondecreasing integers (N,) with the smallest sum of absolute differences from the values (N,)."""
    highest, lowest = np.maximum.accumulate(values), np.minimum.accumulate(values[::-1])[::-1]
    if np.array_equal(highest, lowest):
        return values
    heap: list[int] = []
    ascending = np.empty_like(values)
    for i, value in enumerate(values.tolist()):
        heappush(heap, -value)
        if -heap[0] > value:
            heapreplace(heap, -value)
        ascending[i] = -heap[0]
    return np.minimum.accumulate(ascending[::-1])[::-1]


def _common_period(parts: Sequence[Array], ticks: Sequence[Array]) -> float:
    """Common slope [s] of times (N,) [s] over ticks (N,) of parts with offsets of their own, by least squares."""
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


def ask_for_time(table: Table, chosen: str, used: Collection[str], source: str) -> None:
    """Refuse a table whose column of time was not stated and has a rival that disagrees with it.

    `chosen`: the column `t`, "" if there is none; `used`: columns of signals.

    Raises:
        RecordingError: two columns of time disagree.
    """
    for first, other, apart in rivals(table, chosen, used):
        fact = f"{source} has two columns of time that differ by up to {apart * 1e3:.3g} ms: {first} and {other}"
        choice = f'write t = "{first}" or t = "{other}" into a column map (--columns)'
        raise RecordingError(f"{fact}; {choice}, preferably the time at which the robot took the sample")


def rivals(table: Table, chosen: str, used: Collection[str]) -> Iterator[tuple[str, str, float]]:
    """Column of time, one that disagrees with it, and by how much [s].

    Columns count as time if they are named so and increase. They agree up to a constant, a decimal unit, and rounding.
    """
    names = [name for name in table.columns if name not in used and "t" in kinds_of(name)]
    names = [chosen, *(name for name in names if name != chosen)] if chosen else names
    times = dict(increasing(table, names)) if len(names) > 1 else {}
    first = next(iter(times), "")
    if chosen and first != chosen:
        return
    for other in list(times)[1:]:
        if (apart := _apart(times[first], times[other])) is not None:
            yield first, other, apart


def numbers_of(table: Table, names: Sequence[str], rows: int) -> Iterator[tuple[str, Array]]:
    """Columns of numbers (N,) [any unit], of the first rows."""
    for name in names:
        with suppress(RecordingError):  # a column of texts
            yield name, table.read([name], 0, min(table.rows, rows))[:, 0]


def increasing(table: Table, names: Sequence[str]) -> Iterator[tuple[str, Array]]:
    """Columns (N,) [any unit] of numbers that never decrease, from the first rows."""
    for name, values in numbers_of(table, names, CHUNK):
        steps = np.diff(values[np.isfinite(values)])
        if len(steps) >= FEW_TIMES and np.all(steps >= 0) and steps.any():
            yield name, values


def _apart(t: Array, other: Array) -> float | None:
    """Range of the differences [s] of two columns (N,) [any unit]; None if they agree or are not alike."""
    both = np.isfinite(t) & np.isfinite(other)
    t, other = t[both], other[both]
    if len(t) < FEW_TIMES or not min(np.ptp(t), np.ptp(other)) > 0:
        return None
    ratio = np.ptp(t) / np.ptp(other)
    unit = 10.0 ** (3 * round(np.log10(ratio) / 3))
    if not 1 / RATE <= ratio / unit <= RATE:
        return None
    steps = np.diff(t)
    period = float(np.median(steps[steps > 0]))
    apart = (t - t[0]) - unit * (other - other[0])
    spread = float(np.diff(np.quantile(apart, [1 - SHARE, SHARE]))[0])
    rounding = max(resolution(t[-64:]), unit * resolution(other[-64:]))  # of the coarser one
    if spread <= (1 + DIFFERENT) * rounding + DIFFERENT * period:
        return None
    return float(np.ptp(apart)) * (1.0 if period <= MAX_STEP else UNITS[likely_unit(period)])


@dataclass(frozen=True, eq=False)
class Choice(Frozen):
    """Clock of the rows of a recording.

    Kinds: `stamps`, times as recorded (even steps up to rounding, or any others, which are resampled); `even`, an even
    clock without the errors of the stamps; `ticks`, the same where rows are missing, counted by the stamps.
    """

    kind: str
    period: float  # [s] of the uniform grid
    jitter: float = 0.0  # [s] rms error of the stamps that the clock removes
    missing: int = 0  # dropped rows, without gaps
    times: Array | None = field(default=None, repr=False)  # (rows,) [s] of all rows of the file; None: its stamps

    @classmethod
    def stamps(cls, period: float) -> Choice:
        """The stamps as they are, with a period [s]."""
        return cls("stamps", period)
