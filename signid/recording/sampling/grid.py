"""Stretches of usable rows, and samples on their uniform time grids."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import RecordingError, shorten
from ...types import Array, Frozen, Recording, Samples
from .clock import Choice
from .knots import BLOCK, HELD, Knots, find_knots, same_knots, spline_values

STRIDE = 4096  # [kept rows] between two stored time stamps
MIN_STRETCH_SAMPLES = 8  # minimum length of a stretch [samples]
BRIEFEST = 0.5  # minimum duration of a stretch [s]
SESSION = 4 * 3600.0  # longest time over which recordings count as one session [s]: a shift without a cold start
COUNT = 6  # number of stretches of a subsample
Span = tuple[int, int]
WINDOW = 8192  # [rows] part in which knots are searched
BLOCKS, MIN_BLOCK_ROWS, MIN_BLOCK_STEPS = 12, 160, 16  # blocks that must agree; their least length [rows], [steps]
KNOT_BLOCKS_SHARE = 0.8  # smallest share of blocks that agree
SIGNALS = ("q", "tau", "dq", "ddq", "q_des")
BOUND = ("q", "tau")  # signals that bound the rate
POINTS = 6  # neighbours of an interpolated value (Lagrange). Error of a sine: 3 % of 4 samples a period, 0.05 % of 8
SAME_OFFSET = 1e-10  # [rows] rounding error of a place
LENGTH, PAD = 256, 12  # [knots] of one fit; beyond its ends
EXACT = 1e-6  # [rows] distance at which instants coincide
Read = Callable[[int, int], Samples]  # kept rows low..high of a stretch


@dataclass(frozen=True, eq=False)
class Stretch(Frozen):
    """Consecutive rows start..stop of a file without the dropped ones, and the used part of their grid."""

    start: int
    stop: int
    stamps: Array  # (k,) [s] times of the first and every 4096th kept row
    kept: int  # number of rows without the dropped ones
    size: int  # number of grid samples over all rows
    first: int  # first grid sample of the span
    count: int  # number of samples of the span
    row: float = 0.0  # [rows] of its first row from that of the first stretch, where `Sampling.content` is not None
    offset: float = 0.0  # [rows] of its first sample from its first row, where `Sampling.content` is not None

    @property
    def span(self) -> Span:
        """Rows of the used part; approximate for nonuniform sampling."""
        rows = self.stop - self.start
        low, high = (round(rows * k / self.size) for k in (self.first, self.first + self.count))
        return self.start + low, self.start + high

    def part(self, low: int, high: int) -> Stretch:
        """Samples low..high of this stretch."""
        return replace(self, first=self.first + low, count=high - low)


@dataclass(frozen=True, eq=False)
class Sampling(Frozen):
    """Sampling and usable rows of a recording of n joints; rows count from 0 here and from 1 in messages."""

    period: float  # [s] of the uniform grid: mean for uniform sampling, else median
    uniform: bool  # whether the rows form the grid
    jitter: tuple[float, float]  # [s] shortest and longest time step between kept samples of a span
    duplicates: int  # number of rows with the time of the previous row
    spans: tuple[Span, ...]  # usable rows start..stop
    lower: Array  # (n,) [rad or m] smallest position
    upper: Array  # (n,) [rad or m] largest position
    speed: Array  # (n,) [rad/s or m/s] rms velocity
    torque_rms: Array  # (n,) [N.m or N], NaN for joints without torque
    rows: int  # number of usable rows
    duration: float  # total duration of all spans [s]
    notes: tuple[str, ...]
    stretches: tuple[Stretch, ...]  # one per span
    dropped: NDArray[np.intp]  # (duplicates,) dropped rows
    turn_rows: NDArray[np.intp]  # (k,) rows at which an encoder wraps
    turns: Array  # (k, n) full turns to be added from these rows on [1], fractions for registers of other spans
    incomplete: frozenset[str]  # columns with missing values
    origin: float = 0.0  # [s] time stamp of the start of the session: its first recording, or `time_origin`
    clock: Choice = Choice.stamps(0.0)  # clock of the rows
    content: Content | None = None  # None: the rows have content up to their rate

    @property
    def step(self) -> float:
        """Time between rows [s]."""
        return self.period if self.content is None else self.content.row

    @property
    def content_rate(self) -> float:
        """Rate at which the recording has content of its own [Hz]: that of the samples."""
        return 1 / self.period

    def stretch(self, span: Span) -> Stretch:
        """Stretch of a span.

        Raises:
            KeyError: unknown span.
        """
        i = bisect_left(self.spans, tuple(span))
        if i == len(self.spans) or self.spans[i] != tuple(span):
            raise KeyError(span)
        return self.stretches[i]

    def length(self, span: Span) -> int:
        """Number of samples of the uniform grid over a span."""
        return self.stretch(span).count


def split(sampling: Sampling, share: float) -> tuple[Sampling, Sampling]:
    """Split a recording in time into a share of its samples and the rest, on the same grid.

    Raises:
        RecordingError: one of the two parts is too short.
    """
    least = max(MIN_STRETCH_SAMPLES, round(BRIEFEST / sampling.period))
    cut = round(share * sum(stretch.count for stretch in sampling.stretches))
    first, last = [], []
    for stretch in sampling.stretches:
        k = min(max(cut, 0), stretch.count)
        k = 0 if k < least else stretch.count if stretch.count - k < least else k
        if k:
            first.append(stretch.part(0, k))
        if k < stretch.count:
            last.append(stretch.part(k, stretch.count))
        cut -= stretch.count
    if not first or not last:
        fault = f"the recording is too short ({sampling.duration:.3g} s) to hold out {1 - share:.0%} of it"
        raise RecordingError(f"{fault}; record for longer, or give another recording to hold out")
    return _restrict(sampling, first), _restrict(sampling, last)


def between(sampling: Sampling, intervals: Sequence[tuple[float, float]]) -> Sampling:
    """Samples from `start` to `stop` [s] of each interval, on the same grid; intervals ascend without overlap."""
    parts = []
    for stretch in sampling.stretches:
        first = stretch.stamps[0] + stretch.first * sampling.period
        for interval in intervals:
            low, high = (int(np.ceil((t - first) / sampling.period - 1e-6)) for t in interval)
            low, high = max(0, low), min(stretch.count, high + 1)
            parts += [stretch.part(low, high)] if high - low >= MIN_STRETCH_SAMPLES else []
    return _restrict(sampling, parts)


def select_stretches(sampling: Sampling, seconds: float) -> Sampling:
    """Select equally spaced stretches with a total duration [s]; a shorter recording is returned unchanged."""
    total = sum(stretch.count for stretch in sampling.stretches)
    size = max(MIN_STRETCH_SAMPLES, round(seconds / sampling.period / COUNT))
    if total <= COUNT * size:
        return sampling
    starts = np.linspace(0, total - size, COUNT).round().astype(int).tolist()
    ends = np.cumsum([stretch.count for stretch in sampling.stretches])
    parts = []
    for start in starts:
        for stretch, end in zip(sampling.stretches, ends.tolist(), strict=True):
            low, high = max(0, start + stretch.count - end), min(stretch.count, start + size + stretch.count - end)
            parts += [stretch.part(low, high)] if high - low >= MIN_STRETCH_SAMPLES else []
    return _restrict(sampling, parts)


def one_after_another(samplings: Sequence[Sampling]) -> list[Sampling]:
    """Samplings of one session, whose time counts from the start of its first recording.

    Stamps that begin again in each file are taken to follow those of the file before without a pause; stamps since
    1970 count from the first, if all lie within `SESSION`.
    """
    first = [float(s.stretches[0].stamps[0]) for s in samplings]
    last = [float(s.stretches[-1].stamps[0]) + s.stretches[-1].size * s.period for s in samplings]
    if any(s.origin for s in samplings):
        near = all(s.origin for s in samplings) and 0 <= last[-1] - first[0] <= SESSION
        return [replace(s, origin=samplings[0].origin) for s in samplings] if near else list(samplings)
    out, before = list[Sampling](), 0.0
    for k, sampling in enumerate(samplings):
        if k and first[k] < last[k - 1]:
            before += last[k - 1] - first[k]
        out.append(replace(sampling, origin=-before))
    return out


def samples(recording: Recording, sampling: Sampling, span: Span, start: int, stop: int) -> Samples:
    """Read samples start..stop of the uniform grid of a span, bitwise independent of the range; reads only these rows.

    For uniform sampling, the samples are the rows without duplicates, at the ideal times of the grid. Otherwise signals
    are interpolated by cubic Hermite splines with the slopes of parabolas through three neighbours (Catmull-Rom on
    nonuniform stamps). Absolute torques are interpolated linearly, so that they remain nonnegative.

    Source: Catmull, Rom, A class of local interpolating splines, 1974; de Boor, A Practical Guide to Splines, 1978,
    chapter IV (Bessel slopes).
    """
    stretch = sampling.stretch(span)
    low, high = stretch.first + start, stretch.first + min(stop, stretch.count)
    t = stretch.stamps[0] + np.arange(low, high) * sampling.period
    if not len(t):
        return _rows(recording, sampling, stretch, 0, 0)
    if sampling.content is not None:
        u = np.asarray(stretch.offset + np.arange(low, high) * sampling.content.grid.step)
        read = row_reader(recording, sampling, stretch)
        at_instants: Any = content_samples(sampling.content, read, stretch.row, stretch.kept, u)
        tau = np.where(recording.signed, at_instants["tau"], np.maximum(at_instants["tau"], 0.0))
        return Samples(t=t, **{**at_instants, "tau": tau}, origin=sampling.origin)
    if sampling.uniform:
        return _rows(recording, sampling, stretch, low, high)._replace(t=t, origin=sampling.origin)
    blocks = np.searchsorted(stretch.stamps, t[[0, -1]], side="right") - 1
    first, last = max(0, blocks[0] * STRIDE - 1), min(stretch.kept, (blocks[1] + 1) * STRIDE + 2)
    rows = _rows(recording, sampling, stretch, first, last)
    signals, n = [x for x in rows[1:6] if x is not None], rows.q.shape[1]
    linear = np.zeros(n * len(signals), bool)
    linear[n : 2 * n] = ~recording.signed
    values = _hermite(rows.t, np.concatenate(signals, axis=1), t, linear)
    parts = iter(np.split(values, len(signals), axis=1))
    return Samples._make([t, *(None if x is None else next(parts) for x in rows[1:6]), sampling.origin, None])


def row_reader(recording: Recording, sampling: Sampling, stretch: Stretch) -> Callable[[int, int], Samples]:
    """Reader of the kept rows low..high of a stretch."""
    return lambda low, high: _rows(recording, sampling, stretch, low, high)


def at_content(sampling: Sampling, content: Content) -> Sampling:
    """The same sampling with samples at the rate of the content."""
    origin, stretches = float(sampling.stretches[0].stamps[0]), []
    for stretch in sampling.stretches:
        row = (float(stretch.stamps[0]) - origin) / content.row
        offset, size = first_sample(content, row, stretch.kept)
        if size >= MIN_STRETCH_SAMPLES and size * content.period >= BRIEFEST:
            stamps = stretch.stamps[:1] + offset * content.row
            stretches.append(replace(stretch, stamps=stamps, size=size, first=0, count=size, row=row, offset=offset))
    if not stretches:
        return sampling
    limited = replace(sampling, period=content.period, uniform=False, content=content)
    return _restrict(limited, stretches)


def row_times(recording: Recording, sampling: Sampling, start: int, stop: int) -> Array:
    """Times (stop - start,) [s] of rows of a file by the clock of its sampling."""
    if sampling.clock.times is not None:
        return sampling.clock.times[start:stop]
    return recording.table.read(recording.columns["t"], start, stop)[:, 0]


def _rows(recording: Recording, sampling: Sampling, stretch: Stretch, low: int, high: int) -> Samples:
    """Kept rows low..high of a stretch, with unwrapped angles."""
    ends = np.searchsorted(sampling.dropped, [stretch.start, stretch.stop])
    dropped = sampling.dropped[slice(*ends)] - stretch.start
    place = dropped - np.arange(len(dropped))  # number of kept rows before each dropped one
    begin, end = (stretch.start + k + int(np.searchsorted(place, k, side="right")) for k in (low, high - 1))
    end = end + 1 if high > low else begin
    rows = recording.read(begin, end, servo=False)
    if sampling.clock.times is not None:
        rows = rows._replace(t=sampling.clock.times[begin:end])
    inside = dropped[slice(*np.searchsorted(dropped + stretch.start, [begin, end]))] + stretch.start - begin
    if len(inside):
        signals: Any = rows._asdict()
        kept = [np.delete(x, inside, axis=0) if isinstance(x, np.ndarray) else x for x in signals.values()]
        rows = Samples._make(kept)
    if len(sampling.turn_rows):
        rows = _unwrap(rows, sampling, np.delete(np.arange(begin, end), inside), stretch.start)
    return rows


def _unwrap(samples: Samples, sampling: Sampling, rows: NDArray[np.intp], start: int) -> Samples:
    """Add full turns to positions at `rows`; desired positions of wrapping joints become the nearest equal angle."""
    turns = np.concatenate([np.zeros((1, sampling.turns.shape[1])), sampling.turns])
    before, at = (np.searchsorted(sampling.turn_rows, x, side="right") for x in (start, rows))
    q = samples.q + 2 * np.pi * (turns[at] - turns[before])
    if samples.q_des is None:
        return samples._replace(q=q)
    steps = np.abs(np.diff(turns, axis=0))
    span = 2 * np.pi * np.where(steps > 0, steps, np.inf).min(axis=0, initial=np.inf)
    span = np.where(np.isfinite(span), span, 2 * np.pi)
    nearest = samples.q_des + span * np.round((q - samples.q_des) / span)
    return samples._replace(q=q, q_des=np.where(sampling.turns.any(axis=0), nearest, samples.q_des))


def _hermite(stamps: Array, y: Array, t: Array, linear: NDArray[np.bool_]) -> Array:
    """Interpolated values (M, c) at the times t (M,) of signals y (N, c) at the stamps (N,); N > 2."""
    h = np.diff(stamps)[:, None]
    chord = np.diff(y, axis=0) / h
    slope = np.empty_like(y)
    slope[1:-1] = (h[1:] * chord[:-1] + h[:-1] * chord[1:]) / (h[:-1] + h[1:])
    slope[0] = chord[0] + (chord[0] - chord[1]) * (h[0] / (h[0] + h[1]))
    slope[-1] = chord[-1] + (chord[-1] - chord[-2]) * (h[-1] / (h[-1] + h[-2]))
    i = np.clip(np.searchsorted(stamps, t, side="right") - 1, 0, len(stamps) - 2)
    after = (t - stamps[i])[:, None]
    u = after / h[i]
    d, s, e = chord[i], slope[i], slope[i + 1]
    smooth = y[i] + after * (s + u * ((3 * d - 2 * s - e) + u * (s + e - 2 * d)))
    return np.where(linear, np.maximum(y[i] + after * d, 0.0), smooth) if linear.any() else smooth


def _restrict(sampling: Sampling, stretches: Sequence[Stretch]) -> Sampling:
    """Restrict a sampling to parts of its stretches, in their order."""
    spans = tuple(stretch.span for stretch in stretches)
    return replace(
        sampling,
        spans=spans,
        stretches=tuple(stretches),
        rows=sum(stop - start for start, stop in spans),
        duration=sum((stretch.count - 1) * sampling.period for stretch in stretches),
    )


@dataclass(frozen=True, eq=False)
class Content(Frozen):
    """Knots of the columns of a recording; rows count from the first one of its first stretch."""

    knots: Mapping[str, tuple[Knots | None, ...]]  # by signal, one for each joint; None: content up to the rate
    row: float  # [s] between rows
    grid: Knots  # the widest among positions and torques

    @property
    def period(self) -> float:
        """Time between samples [s]."""
        return self.grid.step * self.row


def find_content(read: Read, kept: int) -> Mapping[str, tuple[Knots | None, ...]] | None:
    """Knots by signal of the columns of a stretch of kept rows; None if no position and no torque has any."""
    size = min(WINDOW, kept)
    if size < BLOCK:
        return None
    start = (kept - size) // 2
    piece = read(start, start + size)
    content: dict[str, tuple[Knots | None, ...]] = {}
    for name in SIGNALS:
        x = getattr(piece, name)
        if x is None or (name not in BOUND and not any(any(content[key]) for key in BOUND)):
            continue
        complete = np.isfinite(x).all(axis=0)
        columns: list[Knots | None] = [None] * x.shape[1]
        for j, knots in zip(np.flatnonzero(complete).tolist(), find_knots(x[:, complete]), strict=True):
            columns[j] = None if knots is None else _confirmed(knots.moved(start), name, j, read, kept)
        for j, knots in enumerate(columns):  # nearly equal ones become those of the first
            columns[j] = next((other for other in columns[:j] if other and knots and other.near(knots)), knots)
        content[name] = tuple(columns)
    return content if any(any(content[key]) for key in BOUND) else None


def _confirmed(knots: Knots, name: str, joint: int, read: Read, kept: int) -> Knots | None:
    """Knots that hold in most blocks of a column of a stretch, with step and phase from all of them; None otherwise."""
    length = ceil(max(MIN_BLOCK_ROWS, MIN_BLOCK_STEPS * knots.step))
    starts = np.unique(np.linspace(0, kept - length, min(BLOCKS, kept // length)).astype(int)).tolist()
    starts.sort(key=lambda k: abs(k - (kept - length) // 2))  # from the middle outwards
    return same_knots(knots, [(k, getattr(read(k, k + length), name)[:, joint]) for k in starts], KNOT_BLOCKS_SHARE)


def widest(knots: Mapping[str, tuple[Knots | None, ...]]) -> Knots:
    """The widest knots among positions and torques."""
    return max((each for key in BOUND for each in knots.get(key, ()) if each), key=lambda each: each.step)


def content_notes(columns: Mapping[str, Sequence[str]], content: Content) -> Iterator[str]:
    """A sentence for each kind of interpolation and rate."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name, plural in (("q", "positions"), ("tau", "torques")):
        known = [(column, knots) for column, knots in zip(columns[name], content.knots[name], strict=True) if column]
        ways = [
            (column, ("held" if knots.kind == HELD else "interpolated", f"{1 / (knots.step * content.row):.4g}"))
            for column, knots in known
            if knots is not None
        ]
        if len(ways) == len(known) > 1 and len({way for _, way in ways}) == 1:
            ways = [(plural, ways[0][1])]
        for column, way in ways:
            groups.setdefault(way, []).append(column)
    rates = f"rows come at {1 / content.row:.4g} Hz, samples are used at {1 / content.period:.4g} Hz"
    for (how, rate), names in groups.items():
        single = len(names) == 1 and names[0] not in ("positions", "torques")
        listed = " and ".join(names) if len(names) < 3 else shorten(names)
        yield f"{listed} {'is' if single else 'are'} {how} from about {rate} Hz: {rates}"


def first_sample(content: Content, row: float, kept: int) -> tuple[float, int]:
    """First sample [rows of the stretch], and number of samples of a stretch of kept rows that begins at `row`."""
    ends = 0.0
    for columns in content.knots.values():
        for knots in columns:
            if knots is not None and not (knots.on_rows or knots.kind == HELD):
                ends = max(ends, 3 * knots.step + 6)
    grid, first = content.grid, ends - EXACT
    offset = (grid.phase - row) % grid.step
    offset = 0.0 if grid.step - offset < EXACT else offset
    offset += max(0, ceil((first - offset) / grid.step)) * grid.step
    return offset, max(0, floor((kept - 1 - ends - offset + EXACT) / grid.step) + 1)


def content_samples(content: Content, read: Read, row: float, kept: int, u: Array) -> dict[str, Array | None]:
    """Signals (M, n) at the instants u (M,) [rows of a stretch of kept rows that begins at `row`]."""
    low, high = max(0, floor(u[0]) - POINTS), min(kept, ceil(u[-1]) + POINTS + 1)
    rows = {(low, high): read(low, high)}

    def column(name: str, j: int) -> Callable[[int, int], Array]:
        def part(begin: int, end: int) -> Array:
            key = (max(0, begin), min(kept, end))
            if key not in rows:
                rows[key] = read(*key)
            return np.asarray(getattr(rows[key], name)[:, j])

        return part

    result: dict[str, Array | None] = {}
    for name in SIGNALS:
        values = getattr(rows[low, high], name)
        column_knots = () if values is None else content.knots.get(name, (None,) * values.shape[1])
        columns = [
            _at_rows(values[:, j], low, u) if knots is None else _at_knots(knots.moved(-row), column(name, j), kept, u)
            for j, knots in enumerate(column_knots)
        ]
        result[name] = np.column_stack(columns) if columns else None
    return result


def _at_rows(y: Array, low: int, u: Array) -> Array:
    """Values (M,) of a signal y (N,), the first of which is row `low`, at the instants u (M,) [rows]."""
    near = np.rint(u)
    if np.abs(u - near).max(initial=0.0) < EXACT:
        return np.asarray(y[near.astype(int) - low])
    return lagrange(y, u - low)


def lagrange(y: Array, u: Array) -> Array:
    """Values (M, ...) between equidistant ones at places; y: (N, ...) [any unit], u: (M,) [rows]."""
    points = min(POINTS, len(y))
    first = np.clip(np.floor(u).astype(int) - points // 2 + 1, 0, len(y) - points)
    offset = u - first
    offset = offset[:1] if np.ptp(offset) < SAME_OFFSET else offset  # evenly spaced places have the same weights
    total = np.zeros((len(u), *y.shape[1:]))
    for i in range(points):
        others = [k for k in range(points) if k != i]
        weight = np.prod([(offset - k) / (i - k) for k in others], axis=0)
        total += (weight * y.take(first + i, axis=0).T).T
    return total


def _at_knots(knots: Knots, read: Callable[[int, int], Array], kept: int, u: Array) -> Array:
    """Values (M,) at the instants u (M,) [rows] from the values of a column at its knots."""
    place = (u - knots.phase) / knots.step
    near = np.rint(place)
    if np.abs(place - near).max(initial=0.0) * knots.step < 10 * EXACT:
        values = _knot_values(knots, read, kept, int(near[0]), int(near[-1]))
        return np.asarray(values[(near - near[0]).astype(int)])
    most = floor((kept - 1 - knots.phase) / knots.step)
    low, high = max(0, floor(place[0]) - POINTS), min(most, ceil(place[-1]) + POINTS)
    return lagrange(_knot_values(knots, read, kept, low, high), np.asarray(place - low))


def _knot_values(knots: Knots, read: Callable[[int, int], Array], kept: int, low: int, high: int) -> Array:
    """Values at the knots low..high of a column."""
    at = knots.phase + knots.step * np.arange(low, high + 1)
    if knots.kind == HELD or knots.on_rows:
        inside = floor((knots.step - 1) / 2) if knots.kind == HELD else 0  # ticks may come a row too late
        rows = np.clip(np.ceil(at - EXACT).astype(int) + inside, 0, kept - 1)
        return np.asarray(read(int(rows[0]), int(rows[-1]) + 1)[rows - rows[0]])
    values = []  # from least-squares splines on fixed blocks of knots
    for block in range(low // LENGTH, high // LENGTH + 1):
        first, last = max(low, block * LENGTH), min(high, (block + 1) * LENGTH - 1)
        begin = max(0, floor(knots.phase + knots.step * (block * LENGTH - PAD)))
        end = min(kept, ceil(knots.phase + knots.step * ((block + 1) * LENGTH + PAD)))
        y = read(begin, end)
        u = np.arange(begin, begin + len(y), dtype=float)
        values.append(spline_values(u, y, knots, np.asarray(knots.phase + knots.step * np.arange(first, last + 1))))
    return np.concatenate(values)
