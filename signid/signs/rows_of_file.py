"""Signs of thinned samples -> a sign for every row of the recorded file."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..recording.sampling import Sampling
from ..recording.sampling.grid import Stretch, row_times
from ..types import Array, Indices, Mask, Recording

CHUNK_ROWS = 65_536  # [rows] read at a time; bounds memory
MAX_MINIMUM_TORQUE = 0.05  # [rms torque] beyond the samples, lower minima of |torque| may be changes of sign; heuristic
TIME_TOLERANCE = 0.01  # [periods] time tolerance of matching rows to instants; heuristic
EXTRA_ROWS = 64  # [rows] read beyond an interval, so that a row of another time is among them; heuristic
MIN_PARABOLA_ROWS = 3  # [rows] on either side of a minimum for the fit of a parabola, at least; heuristic
MAX_PARABOLA_ROWS = 10  # [rows] the same, at most; heuristic
MAX_KINK_RATIO = 0.5  # [1] of squared residuals with and without a change of sign, where there is one; heuristic

SignMarks = NDArray[np.int8]


def signs_of_rows(recording: Recording, sampling: Sampling, t: Array, first: Indices, signs: SignMarks) -> SignMarks:
    """A sign (rows, n) for every row of a recording: -1 or 1, and 0 in rows of no span.

    Between two samples of different sign, the change is at the smallest |torque| recorded between them. Before the
    first and after the last sample of a span the nearest sign continues; it changes at minima near zero (below 5 % of
    the joint's rms torque, or within a step between rows) where the torque is smoother with a change of sign. Torques
    that have their sign get 1. The recording is read piece by piece.

    The M samples at times t (M,) [s] with signs (M, n) [1] lie on the grids of the spans that are long enough, and
    start a span at the indices first (k,).
    """
    found = np.zeros((len(recording), len(recording.joints)), np.int8)
    pieces = [slice(*ends) for ends in pairwise([*first.tolist(), len(t)])]
    for stretch in sampling.stretches:
        low, high = _span_ends(stretch, sampling.period)
        if pieces and low < t[pieces[0].start] and t[pieces[0].stop - 1] < high:
            piece = pieces.pop(0)
            _fill_span(found, _Span.of(recording, sampling, stretch, t[piece]), signs[piece])
    assert not pieces, "every span of the samples lies in one of the recording, in the same order"
    found[:, recording.signed] = 1
    return found


class _FileRows(NamedTuple):
    """K rows of distinct times, forwards or backwards."""

    number: Indices  # (K,)
    t: Array  # (K,) [s]
    size: Array  # (K, h) absolute torques of the joints without a sign [N.m or N]

    def backwards(self) -> _FileRows:
        return _FileRows(self.number[::-1], self.t[::-1], self.size[::-1])


class _Span(NamedTuple):
    """Rows begin..end of a recording, and the first row at or after each of M samples."""

    recording: Recording
    sampling: Sampling
    hidden: list[int]  # h joints without a sign
    small: Array  # (h,) [N.m or N]
    begin: int
    end: int
    at: Indices  # (M,)
    exact: bool  # whether samples coincide with rows

    @classmethod
    def of(cls, recording: Recording, sampling: Sampling, stretch: Stretch, t: Array) -> _Span:
        low, high = _span_ends(stretch, sampling.period)
        at = _row_at(recording, sampling, stretch, np.array([low, *t, high]))
        begin = stretch.start if stretch.first == 0 else int(at[0])
        end = stretch.stop if stretch.first + stretch.count == stretch.size else int(at[-1])
        hidden = np.flatnonzero(~recording.signed).tolist()
        small, at = MAX_MINIMUM_TORQUE * sampling.torque_rms[hidden], np.clip(at[1:-1], begin, end - 1)
        return cls(recording, sampling, hidden, small, begin, end, at, sampling.uniform)

    def read(self, start: int, stop: int) -> _FileRows:
        """Rows start..stop inside the span, without those that repeat a time."""
        start, stop = max(start, self.begin), min(stop, self.end)
        names = [self.recording.columns["tau"][j] for j in self.hidden]
        inside = slice(*np.searchsorted(self.sampling.dropped, [start, stop]))
        repeated = self.sampling.dropped[inside] - start
        t = np.delete(row_times(self.recording, self.sampling, start, stop), repeated)
        values = np.delete(self.recording.table.read(names, start, stop), repeated, axis=0)
        number = np.delete(np.arange(start, stop), repeated)
        return _FileRows(number, t, np.abs(values * self.recording.torque_per_unit[self.hidden]))


def _span_ends(stretch: Stretch, period: float) -> tuple[float, float]:
    """Times half a period before and after the grid of a span [s]."""
    first, last = stretch.first - 0.5, stretch.first + stretch.count - 0.5
    return float(stretch.stamps[0] + first * period), float(stretch.stamps[0] + last * period)


def _row_at(recording: Recording, sampling: Sampling, stretch: Stretch, t: Array) -> Indices:
    """First row at or after each instant t (k,): from the grid where rows lie on it, else from their stamps."""
    if sampling.uniform:
        kept = np.ceil((t - stretch.stamps[0]) / sampling.period - TIME_TOLERANCE).astype(np.intp)
        inside = slice(*np.searchsorted(sampling.dropped, [stretch.start, stretch.stop]))
        place = sampling.dropped[inside] - stretch.start
        place = place - np.arange(len(place))  # how many rows are kept before each dropped one
        return np.asarray(stretch.start + kept + np.searchsorted(place, kept, side="right"))
    rows = np.full(len(t), stretch.start, dtype=np.intp)
    for start in range(stretch.start, stretch.stop, CHUNK_ROWS):
        stop = min(start + CHUNK_ROWS, stretch.stop)
        stamps = row_times(recording, sampling, start, stop)
        rows += np.searchsorted(stamps, t - TIME_TOLERANCE * sampling.period)
    return rows


def _fill_span(found: SignMarks, span: _Span, signs: SignMarks) -> None:
    """Set the signs of the rows of a span."""
    own = signs[:, span.hidden]
    changes = np.repeat(span.at[1:, None], len(span.hidden), axis=1)  # rows from which the next sample's sign holds
    turning = np.flatnonzero((own[1:] != own[:-1]).any(axis=1))  # intervals between samples in which a sign changes
    for some in np.split(turning, np.flatnonzero(np.diff(span.at[turning] // CHUNK_ROWS)) + 1):
        if not len(some):
            continue
        rows = span.read(int(span.at[some[0]]) - EXTRA_ROWS, int(span.at[some[-1] + 1]) + EXTRA_ROWS)
        for i in range(len(span.hidden)):
            which = some[own[some, i] != own[some + 1, i]]
            if len(which):
                places = (np.searchsorted(rows.number, span.at[which + k]) for k in (0, 1))
                low, high = (np.minimum(place, len(rows.number) - 1) for place in places)
                changes[which, i] = rows.number[_crossings(rows.t, rows.size[:, i], low, high, span.exact)]
    for i, j in enumerate(span.hidden):
        lengths = np.diff([span.begin, *changes[:, i], span.end])
        found[span.begin : span.end, j] = np.repeat(own[:, i], lengths)
    _fill_edges(found, span, own)


def _crossings(t: Array, size: Array, low: Indices, high: Indices, exact: bool) -> Indices:
    """First row of the new sign in each interval low..high (k,), given the absolute torques size (K,) at times t.

    The smallest value gets the sign with the smaller second difference between its neighbours of opposite signs.
    """
    lengths = high - low + 1
    begin = np.cumsum(lengths) - lengths
    rows = np.arange(lengths.sum()) + np.repeat(low - begin, lengths)
    hits = np.flatnonzero(size[rows] == np.repeat(np.minimum.reduceat(size[rows], begin), lengths))
    lowest = rows[hits[np.searchsorted(hits, begin)]]
    return np.asarray(np.clip(lowest + _keeps_sign(t, size, lowest), low + exact, high))


def _keeps_sign(t: Array, size: Array, lowest: Indices) -> Mask:
    """Whether the smallest value of each interval has the sign of the row before it, not of the row after."""
    before, after = np.maximum(lowest - 1, 0), np.minimum(lowest + 1, len(size) - 1)
    return np.asarray(size[before] * np.abs(t[after] - t[lowest]) > size[after] * np.abs(t[lowest] - t[before]))


def _fill_edges(found: SignMarks, span: _Span, signs: SignMarks) -> None:
    """Change signs before the first and after the last sample of a span."""
    step = min(max(MIN_PARABOLA_ROWS, int(span.at[-1] - span.at[0]) // max(1, len(span.at) - 1)), MAX_PARABOLA_ROWS)
    first, last = int(span.at[0]), int(span.at[-1]) + span.exact
    left, right = span.read(span.begin, first + step + 1).backwards(), span.read(last - step - 1, span.end)
    for i, j in enumerate(span.hidden):
        known = int(np.sum(left.number >= first)) + int(found[first, j] != signs[0, i])
        for turn in _kinks(left, i, known, float(span.small[i]), step):
            found[span.begin : left.number[turn - 1], j] *= -1
        known = int(np.sum(right.number < last)) + int(found[max(last - 1, span.begin), j] != signs[-1, i])
        for turn in _kinks(right, i, known, float(span.small[i]), step):
            found[right.number[turn] : span.end, j] *= -1


def _kinks(rows: _FileRows, joint: int, known: int, small: float, step: int) -> list[int]:
    """First rows of a new sign beyond the `known` rows, at least `step` apart, the clearest kinks first."""
    size = rows.size[:, joint]
    steps = np.abs(np.diff(size, prepend=size[0], append=size[-1]))
    low = size < np.maximum(small, np.maximum(steps[1:], steps[:-1]))  # near zero, or within a step between rows
    lowest = np.flatnonzero((size[1:-1] <= size[:-2]) & (size[1:-1] < size[2:]) & low[1:-1]) + 1
    turns = lowest + _keeps_sign(rows.t, size, lowest)
    found: list[int] = []
    for bend, turn in sorted((_kink_ratio(rows.t, size, turn, step), turn) for turn in turns[turns >= known].tolist()):
        if bend < MAX_KINK_RATIO and all(abs(turn - other) > step for other in found):
            found.append(turn)
    return found


def _kink_ratio(t: Array, size: Array, turn: int, step: int) -> float:
    """Ratio of the squared residuals of a parabola with and without a change of sign at a row; 0: a perfect change."""
    around = slice(max(0, turn - step), turn + step)
    x, y = t[around] - t[turn], size[around]
    both = np.stack([y, np.where(x < 0 if t[-1] > t[0] else x > 0, y, -y)], axis=1)
    _, (kept, changed), *_ = np.polyfit(x / np.ptp(x), both, 2, full=True)
    return float(changed / max(kept, 1e-300))
