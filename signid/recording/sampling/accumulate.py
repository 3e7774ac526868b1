"""Statistics from one pass over a recording, and the spans of registers of positions."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...types import Array, Indices, Mask, Recording
from .clock import CHUNK, Clock
from .grid import BRIEFEST, MIN_STRETCH_SAMPLES, STRIDE, Stretch

SMOOTH = 0.02  # [s] averaging time of velocities
WINDOWS = (16, 256)  # [samples] lengths over which a uniform clock must not drift
UNEVEN = 1e-3  # tolerance of a uniform clock [periods]
TURN = 0.16  # [1] jumps this close to the span of a register, relative to it, are wraps
FAST = 10.0  # [1] step that is a jump, over the largest usual step
STEP_QUANTILE = 0.995  # [1] quantile of the steps that is the largest usual one; jumps are rare
ALMOST = 0.8  # [1] smallest jump over the range of the positions: from one end to the other
NICE = (*(2 * np.pi * k for k in (1, 2, 3, 4, 5, 8, 10, 16)), 12.5, 25.0, 50.0, 95.5, 191.0)  # [rad] of known drives
SPAN_TOLERANCE = 2e-3  # [1] relative distance from a usual span at which it is that span


@dataclass
class Range:
    """Extremes and sums over samples of n joints."""

    lower: Array  # (n,) [rad or m]
    upper: Array  # (n,) [rad or m]
    least: Array  # (n,) [N.m or N]
    most: Array  # (n,) [N.m or N]
    power: Array  # (n,) [N2.m2 or N2] sum of squares
    motion: Array  # (n,) [rad2/s2 or m2/s2] sum of squares
    velocities: int = 0
    samples: int = 0
    shortest: float = np.inf  # shortest time step [s]
    longest: float = 0.0  # longest time step [s]

    @classmethod
    def empty(cls, n: int) -> Range:
        """Range of no samples."""
        wide = np.full(n, np.inf)
        return cls(wide, -wide, wide, -wide, np.zeros(n), np.zeros(n))

    def add(self, other: Range) -> None:
        """Merge another range into this one."""
        self.lower, self.upper = np.minimum(self.lower, other.lower), np.maximum(self.upper, other.upper)
        self.least, self.most = np.minimum(self.least, other.least), np.maximum(self.most, other.most)
        self.power, self.motion = self.power + other.power, self.motion + other.motion
        self.velocities, self.samples = self.velocities + other.velocities, self.samples + other.samples
        self.shortest, self.longest = min(self.shortest, other.shortest), max(self.longest, other.longest)


@dataclass
class OpenStretch:
    """A stretch that may continue in the next chunk."""

    start: int
    range: Range
    turns: Array  # (n,) full turns since its start [1], fractions where a register does not end at full turns
    q: Array  # (n,) [rad or m] last recorded position
    stamps: list[float] = field(default_factory=list)
    t: float = 0.0  # [s] time of the last row
    stop: int = 0
    kept: int = 0

    def closed(self, period: float, uniform: bool) -> Stretch:
        """The whole stretch on a grid of a period [s]."""
        size = self.kept if uniform else int((self.t - self.stamps[0]) / period * (1 + 1e-9)) + 1
        return Stretch(self.start, self.stop, np.array(self.stamps), self.kept, size, 0, size)


class Accumulator:
    """Accumulator of consecutive chunks: call `take` for each, then `close`."""

    def __init__(self, clock: Clock, spans: Array) -> None:
        """Start without rows; spans: (n,) [rad or m] after which positions begin again, 0 where they do not."""
        n = len(spans)
        self.clock, self.spans, self.total = clock, spans, Range.empty(n)
        self.stretches: list[OpenStretch] = []
        self.gaps, self.longest_gap = 0, (0.0, 0.0)  # number; length and start [s]
        self.short, self.uniform = 0, True
        self.turn_rows: list[int] = []
        self.turns: list[Array] = []
        self._open: OpenStretch | None = None
        self._last, self._missing, self._turned = np.nan, False, np.zeros(n)

    def take(self, start: int, t: Array, q: Array, tau: Array, missing: Mask, dropped: Mask) -> None:
        """Add a chunk of N rows, the first of which has the number `start`.

        t: (N,) nondecreasing times [s]; q: (N, n) [rad or m]; tau: (N, n) [N.m or N];
        missing: (N,) rows that lack a value; dropped: (N,) rows that repeat a time.
        """
        index = np.flatnonzero(~missing & ~dropped)
        if not len(index):
            self._missing |= bool(missing.any())
            return
        gone = np.diff(np.cumsum(missing)[index], prepend=-1 if self._missing else 0) > 0
        step = np.diff(t[index], prepend=self._last)
        late = ~gone & (step > self.clock.gap)
        self.gaps += int(late.sum())
        worst = int(np.argmax(np.where(late, step, 0.0)))
        if late[worst] and step[worst] > self.longest_gap[0]:
            self.longest_gap = float(step[worst]), float(t[index[worst]] - step[worst])
        breaks = gone | late
        breaks[0] |= self._open is None
        self._last, self._missing = float(t[index[-1]]), bool(missing[index[-1] :].any())
        bounds = np.concatenate([[0], np.flatnonzero(breaks[1:]) + 1, [len(index)]])
        usable = np.diff(bounds) >= MIN_STRETCH_SAMPLES
        usable[[0, -1]] = True  # may continue in the neighbouring chunks
        self.short += int(np.sum(~usable))
        for k in np.flatnonzero(usable):
            rows = index[bounds[k] : bounds[k + 1]]
            if breaks[bounds[k]]:
                self.close()
                none = Range.empty(len(self.spans))
                self._open = OpenStretch(start + int(rows[0]), none, 0 * self._turned, q[rows[0]])
            assert self._open is not None, "the first row starts a stretch"
            self._extend(self._open, start + rows, t[rows], q[rows], tau[rows])

    def close(self) -> None:
        """End the open stretch; discard it if it is too short."""
        if self._open is None:
            return
        if self._open.kept < MIN_STRETCH_SAMPLES or self._open.t - self._open.stamps[0] < BRIEFEST:
            self.short += 1
        else:
            self.total.add(self._open.range)
            self.stretches.append(self._open)
        self._turned = self._turned + self._open.turns
        self._open = None

    def _extend(self, stretch: OpenStretch, rows: Indices, t: Array, q: Array, tau: Array) -> None:
        steps = np.diff(t, prepend=stretch.t) if stretch.kept else np.diff(t)
        stretch.range.add(self._measure(t, self._unwrap(stretch, rows, q), tau, steps))
        self.uniform = self.uniform and self._is_uniform(t, steps)
        stretch.stamps.extend(t[-stretch.kept % STRIDE :: STRIDE].tolist())
        stretch.kept, stretch.stop = stretch.kept + len(t), int(rows[-1]) + 1
        stretch.t, stretch.q = float(t[-1]), q[-1]

    def _unwrap(self, stretch: OpenStretch, rows: Indices, q: Array) -> Array:
        """Positions (N, n) [rad or m] without wraps of the encoder."""
        if not self.spans.any():
            return q
        step = np.diff(q, axis=0, prepend=stretch.q[None])
        wraps = (np.abs(np.abs(step) - self.spans) < TURN * self.spans) & (self.spans > 0)
        if not wraps.any() and not stretch.turns.any():
            return q
        turns = stretch.turns + np.cumsum(-np.sign(step) * wraps, axis=0) * self.spans / (2 * np.pi)
        for k in np.flatnonzero(wraps.any(axis=1)):
            self.turn_rows.append(int(rows[k]))
            self.turns.append(self._turned + turns[k])
        stretch.turns = turns[-1]
        return np.asarray(q + 2 * np.pi * turns)

    def _measure(self, t: Array, q: Array, tau: Array, steps: Array) -> Range:
        x, y = map(np.ascontiguousarray, (q.T, tau.T))  # reductions over contiguous rows are several times faster
        lag = min(max(1, round(SMOOTH / self.clock.period)), len(t) - 1)
        velocity = (x[:, lag:] - x[:, :-lag]) / (t[lag:] - t[:-lag]) if lag else x[:, :0]
        ends = (float(steps.min()), float(steps.max())) if len(steps) else (np.inf, 0.0)
        squares = (np.einsum("ij,ij->i", y, y), np.einsum("ij,ij->i", velocity, velocity))
        return Range(x.min(1), x.max(1), y.min(1), y.max(1), *squares, velocity.shape[1], len(t), *ends)

    def _is_uniform(self, t: Array, steps: Array) -> bool:
        """Whether time is linear up to rounding, from row to row and over longer windows."""
        mean, rounding = self.clock.mean, self.clock.rounding
        windows = [(1, steps), *((m, t[m:] - t[:-m]) for m in WINDOWS)]
        return all(bool(np.all(np.abs(x - m * mean) <= UNEVEN * m * mean + rounding)) for m, x in windows)


def register_spans(recording: Recording) -> Array:
    """Span (n,) [rad or m] of each position's register, 0 where no wrap is seen.

    A wrap is a jump from one end of the range of the positions to the other, far larger than the steps beside it; all
    jumps of a joint have the same size up to the motion in one row. Full turns, which need no end of a range, are
    removed elsewhere.
    """
    columns = recording.columns["q"]
    n, pieces = len(columns), range(0, len(recording), CHUNK)
    low, high, longest, last = np.full(n, np.inf), np.full(n, -np.inf), np.zeros(n), np.full(n, np.nan)
    for start in pieces:
        q = recording.table.read(columns, start, start + CHUNK)
        for j in range(n):
            known = q[np.isfinite(q[:, j]), j]
            if len(known):
                steps = np.abs(np.diff(known, prepend=last[j]))
                low[j], high[j], last[j] = min(low[j], known.min()), max(high[j], known.max()), known[-1]
                longest[j] = np.fmax(longest[j], np.fmax.reduce(steps))
    spans = np.zeros(n)
    for j in np.flatnonzero(longest > ALMOST * (high - low)).tolist():  # only these are held in memory, one at a time
        x = recording.table.read(columns[j : j + 1], 0, len(recording))[:, 0]
        spans[j] = _span(x[np.isfinite(x)])
    return spans


def _span(q: Array) -> float:
    """Span of the register of positions q (N,) [rad or m]; 0 without a wrap."""
    step = np.diff(q)
    usual = float(np.quantile(np.abs(step), STEP_QUANTILE)) if len(step) > 2 else 0.0
    low, high = (float(q.min()), float(q.max())) if len(q) else (0.0, 0.0)
    jumps = np.flatnonzero(np.abs(step) > max(FAST * usual, ALMOST * (high - low), 1e-9))
    if not len(jumps) or len(jumps) > 0.01 * len(step):
        return 0.0
    ends = np.column_stack([q[jumps], q[jumps + 1]])
    width = 2 * max(usual, float(np.abs(step[np.setdiff1d(np.arange(len(step)), jumps)]).max(initial=0.0)))
    if np.any(np.minimum(ends - low, high - ends) > width + 0.05 * (high - low)):
        return 0.0
    beside = (step[np.maximum(jumps - 1, 0)] + step[np.minimum(jumps + 1, len(step) - 1)]) / 2
    if np.any(beside * step[jumps] >= 0):  # a wrap is against the motion; a value that drops out is not, there or back
        return 0.0
    sizes = np.abs(beside - step[jumps])
    span = float(np.median(sizes))
    if np.ptp(sizes) > max(width, SPAN_TOLERANCE * span) or width > 0.2 * span:
        return 0.0
    nice = min(NICE, key=lambda known: abs(known - span))
    return nice if abs(nice - span) <= SPAN_TOLERANCE * span else span
