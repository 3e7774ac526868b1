"""Symmetric FIR filters: zero phase, finite memory, results that do not depend on how a recording is cut."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..types import Array

Value = TypeVar("Value", bound=np.generic)
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
HALF = 4  # samples that a difference needs on either side
ATTENUATION = 60.0  # [dB] of the stop band of a low-pass; Kaiser's formulas hold from 50 on
SEGMENT = 64  # smallest number of samples of a segment in `Decimator`, unless the filter is shorter


def lowpass(rate: float, cutoff: float) -> Array:
    """Taps of a symmetric Kaiser low-pass with pass band up to 0.75 cutoff and stop band from 1.25 cutoff on.

    The odd number of taps (k,) [1] sum to 1. The cut-off is the frequency of half amplitude [Hz]; from 0.4 of the
    sampling rate on there is no filter.

    Source: Kaiser, Nonrecursive digital filter design using the I0-sinh window function, IEEE ISCAS 1974. Own code,
    since importing scipy.signal takes longer than most identifications.
    """
    if cutoff >= 0.4 * rate:
        return np.ones(1)
    count = int(np.ceil((ATTENUATION - 7.95) / (2.285 * np.pi * cutoff / rate) + 1)) | 1
    taps = np.sinc(2 * cutoff / rate * (np.arange(count) - count // 2)) * np.kaiser(count, 0.1102 * (ATTENUATION - 8.7))
    return np.asarray(taps / taps.sum())


def smooth(signal: Array, taps: Array, whole: bool = False) -> Array:
    """Filtered signal (N, c) [any unit] where symmetric taps (k,) [1] overlap it fully, (N - k + 1, c).

    The `whole` result has all N samples; the signal is continued by its first and last values.
    """
    if whole:
        signal = np.pad(signal, ((len(taps) // 2,) * 2, (0, 0)), mode="edge")
    return signal if len(taps) == 1 else _correlated(signal, taps)


def differentiate(signal: Array, period: float) -> tuple[Array, Array]:
    """First and second derivatives, (N - 8, c) each, of a signal (N, c) [any unit], by nine-point central differences.

    Source: Fornberg, Mathematics of Computation 51, 1988, table 1 (eighth order).
    """
    return _correlated(signal, FIRST / period), _correlated(signal, SECOND / period**2)


def moving_minimum(signal: Array, half: int) -> Array:
    """Minimum (N, c) of a signal (N, c) [any unit] over `half` samples on either side; fewer at the ends.

    Equal to `scipy.ndimage.minimum_filter1d`. Importing that takes longer than most identifications.
    """
    found, width = np.pad(signal, ((half, half), (0, 0)), mode="edge"), 1
    while 2 * width <= 2 * half + 1:
        found, width = np.minimum(found[:-width], found[width:]), 2 * width
    rest = 2 * half + 1 - width
    return np.asarray(np.minimum(found[: len(found) - rest], found[rest:]))


class Decimator:
    """Symmetric low-pass evaluated at every `factor`-th sample only, for many columns at once.

    The odd number of taps is symmetric. Each segment of samples has a fixed length and is multiplied by a matrix of
    fixed shape, which gives its share of all outputs that its samples reach. So a row's value does not depend on the
    rows that are computed with it, as long as these begin at a multiple of `block` rows.
    """

    def __init__(self, taps: Array, factor: int) -> None:
        self.taps, self.factor, self.half = taps, factor, len(taps) // 2
        self._reach = -(-len(taps) // factor)  # length of the taps in outputs
        self.block = min(-(-SEGMENT // factor), self._reach if len(taps) > 1 else SEGMENT)
        self.segment = self.block * factor  # samples
        self._matrix = np.zeros((self.block + self._reach - 1, self.segment))
        for row in range(len(self._matrix)):  # this is output row - reach + 1, counted from the segment's first
            start = (row - self._reach + 1) * factor  # sample at which its taps begin
            low, high = max(start, 0), min(start + len(taps), self.segment)
            self._matrix[row, low:high] = taps[low - start : high - start]

    def at(self, samples: NDArray[Value]) -> NDArray[Value]:
        """The samples (N, ...) [any unit], unfiltered, on which the outputs are centred: (M, ...)."""
        return samples[self.half : len(samples) - self.half : self.factor]

    def __call__(self, columns: Array) -> Array:
        """Outputs (M, c) of columns (N, c) [any unit]; the first is centred on sample `half`."""
        starts = range(0, len(columns), self.segment)
        return self.gather((columns[k : k + self.segment] for k in starts), *columns.shape)

    def gather(self, segments: Iterable[Array], samples: int, width: int) -> Array:
        """Outputs (M, c) of N = `samples` rows of c = `width` columns, which arrive as segments (k, c) [any unit].

        The last segment may be shorter. The memory of a segment may be reused.
        """
        out = np.zeros((max(0, (samples - len(self.taps)) // self.factor + 1), width))
        for k, piece in enumerate(segments):
            start = k * self.block
            if len(self.taps) == 1:
                out[start : start + self.block] = piece[:: self.factor]
                continue
            if len(piece) < self.segment:
                piece = np.concatenate([piece, np.zeros((self.segment - len(piece), width))])
            low, high = max(start - self._reach + 1, 0), min(start + self.block, len(out))
            if low < high:
                first = low - start + self._reach - 1
                out[low:high] += (self._matrix @ piece)[first : first + high - low]
        return out


def _correlated(signal: Array, taps: Array) -> Array:
    """Correlation (N - k + 1, c) of each column with the taps; a value does not depend on its position."""
    out = np.empty((signal.shape[1], max(0, len(signal) - len(taps) + 1)))
    for row, column in zip(out, np.ascontiguousarray(signal.T), strict=True):
        if len(row):
            row[:] = np.correlate(column, taps, "valid")
    return np.ascontiguousarray(out.T)
