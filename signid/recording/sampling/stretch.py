"""Stretches of usable rows with uniform time grids."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...errors import RecordingError
from ...types import Array, Frozen

STRIDE = 4096  # [kept rows] between two stored time stamps
SHORTEST = 8  # minimum length of a stretch [samples]
BRIEFEST = 0.5  # minimum duration of a stretch [s]

Span = tuple[int, int]


COUNT = 6  # number of stretches of a subsample


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

    def part(self, low: int, high: int) -> Stretch:
        """Samples low..high of this stretch."""
        return replace(self, first=self.first + low, count=high - low)


@dataclass(frozen=True, eq=False)
class Sampling(Frozen):
    """Sampling and usable rows of a recording of n joints.

    Rows are counted from 0 here and from 1 in messages.
    """

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
    turns: Array  # (k, n) full turns to be added from these rows on [1]
    incomplete: frozenset[str]  # columns with missing values

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
    least = max(SHORTEST, round(BRIEFEST / sampling.period))
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
    return restrict(sampling, first), restrict(sampling, last)


def excerpt(sampling: Sampling, span: Span, low: int, high: int) -> Sampling:
    """Samples low..high of one span, on the same grid."""
    return restrict(sampling, [sampling.stretch(span).part(low, high)])


def restrict(sampling: Sampling, stretches: Sequence[Stretch]) -> Sampling:
    """Restrict a sampling to parts of its stretches, in their order."""
    spans = tuple(_span(stretch) for stretch in stretches)
    return replace(
        sampling,
        spans=spans,
        stretches=tuple(stretches),
        rows=sum(stop - start for start, stop in spans),
        duration=sum((stretch.count - 1) * sampling.period for stretch in stretches),
    )


def _span(stretch: Stretch) -> Span:
    """Rows of the used part of a stretch; approximate for nonuniform sampling."""
    rows = stretch.stop - stretch.start
    low, high = (round(rows * k / stretch.size) for k in (stretch.first, stretch.first + stretch.count))
    return stretch.start + low, stretch.start + high


def select_stretches(sampling: Sampling, seconds: float) -> Sampling:
    """Select equally spaced stretches with a given total duration; a shorter recording is returned unchanged.

    Args:
        sampling: sampling of the recording.
        seconds: total duration of the stretches [s].
    """
    total = sum(stretch.count for stretch in sampling.stretches)
    size = max(SHORTEST, round(seconds / sampling.period / COUNT))
    if total <= COUNT * size:
        return sampling
    starts = np.linspace(0, total - size, COUNT).round().astype(int).tolist()
    return restrict(sampling, [part for start in starts for part in _parts(sampling, start, start + size)])


def _parts(sampling: Sampling, low: int, high: int) -> Iterator[Stretch]:
    """Parts of the stretches within samples low..high of their concatenation; too short parts are omitted."""
    for stretch in sampling.stretches:
        start, stop = max(0, low), min(stretch.count, high)
        if stop - start >= SHORTEST:
            yield stretch.part(start, stop)
        low, high = low - stretch.count, high - stretch.count
