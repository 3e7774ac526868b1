"""Stretches of usable rows, and the uniform grid over each."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...errors import RecordingError
from ...types import Array, Frozen

STRIDE = 4096  # kept rows between two time stamps that are remembered
SHORTEST = 8  # samples
BRIEFEST = 0.5  # s

Span = tuple[int, int]


COUNT = 6  # stretches that are taken


@dataclass(frozen=True, eq=False)
class Stretch(Frozen):
    """Rows start..stop of a file, all usable but the dropped ones, and the part of their grid that counts."""

    start: int
    stop: int
    stamps: Array  # (k,) [s] of the first and every 4096th kept row
    kept: int  # rows that are not dropped
    size: int  # samples of the grid over all of them
    first: int  # sample of the grid that the span begins with
    count: int  # samples of the span

    def part(self, low: int, high: int) -> Stretch:
        """Samples low..high of this one."""
        return replace(self, first=self.first + low, count=high - low)


@dataclass(frozen=True, eq=False)
class Sampling(Frozen):
    """How a recording of n joints is sampled, and which of its rows can be used.

    Rows are counted from 0 here and from 1 in sentences.
    """

    period: float  # [s] of the uniform grid: mean where sampling is uniform, else median
    uniform: bool  # whether the rows are the grid
    jitter: tuple[float, float]  # [s] shortest and longest time between kept samples of a span
    duplicates: int  # rows that repeat the time before
    spans: tuple[Span, ...]  # usable rows start..stop
    lower: Array  # (n,) [rad or m] of the positions
    upper: Array  # (n,) [rad or m]
    speed: Array  # (n,) [rad/s or m/s] root mean square
    torque_rms: Array  # (n,) [N.m or N], NaN where a joint has no torque
    rows: int  # usable
    duration: float  # [s] of all spans
    notes: tuple[str, ...]
    stretches: tuple[Stretch, ...]  # one for each span
    dropped: NDArray[np.intp]  # (duplicates,) rows
    turn_rows: NDArray[np.intp]  # (k,) rows at which an encoder wrapped around
    turns: Array  # (k, n) [1] whole turns to be added from there on
    incomplete: frozenset[str]  # columns of which some row holds no value

    def stretch(self, span: Span) -> Stretch:
        """The stretch of a span.

        Raises:
            KeyError: when the span is none of this sampling.
        """
        i = bisect_left(self.spans, tuple(span))
        if i == len(self.spans) or self.spans[i] != tuple(span):
            raise KeyError(span)
        return self.stretches[i]

    def length(self, span: Span) -> int:
        """Samples of the uniform grid over a span."""
        return self.stretch(span).count


def split(sampling: Sampling, share: float) -> tuple[Sampling, Sampling]:
    """The beginning that holds a share of the samples, and the rest; both on the grid of the whole.

    Raises:
        RecordingError: when one of the two would be too short to be used.
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
        told = f"the recording is too short ({sampling.duration:.3g} s) to hold out {1 - share:.0%} of it"
        raise RecordingError(f"{told}; record for longer, or give another recording to hold out")
    return restrict(sampling, first), restrict(sampling, last)


def excerpt(sampling: Sampling, span: Span, low: int, high: int) -> Sampling:
    """Samples low..high of one span, on the grid of the whole."""
    return restrict(sampling, [sampling.stretch(span).part(low, high)])


def restrict(sampling: Sampling, stretches: Sequence[Stretch]) -> Sampling:
    """The same recording, of which only some parts of its stretches are used, in their order."""
    spans = tuple(_span(stretch) for stretch in stretches)
    return replace(
        sampling,
        spans=spans,
        stretches=tuple(stretches),
        rows=sum(stop - start for start, stop in spans),
        duration=sum((stretch.count - 1) * sampling.period for stretch in stretches),
    )


def _span(stretch: Stretch) -> Span:
    """Rows of the part of a stretch that counts; roughly, where the grid is not the rows."""
    rows = stretch.stop - stretch.start
    low, high = (round(rows * k / stretch.size) for k in (stretch.first, stretch.first + stretch.count))
    return stretch.start + low, stretch.start + high


def spread(sampling: Sampling, seconds: float) -> Sampling:
    """The recording as it is, or stretches that last so long together: its beginning, its end, and some between.

    Args:
        sampling: of the recording.
        seconds: that are enough.
    """
    total = sum(stretch.count for stretch in sampling.stretches)
    size = max(SHORTEST, round(seconds / sampling.period / COUNT))
    if total <= COUNT * size:
        return sampling
    starts = np.linspace(0, total - size, COUNT).round().astype(int).tolist()
    return restrict(sampling, [part for start in starts for part in _parts(sampling, start, start + size)])


def _parts(sampling: Sampling, low: int, high: int) -> Iterator[Stretch]:
    """Samples low..high of all stretches in a row; ends of stretches that are too short to be used are left out."""
    for stretch in sampling.stretches:
        start, stop = max(0, low), min(stretch.count, high)
        if stop - start >= SHORTEST:
            yield stretch.part(start, stop)
        low, high = low - stretch.count, high - stretch.count
