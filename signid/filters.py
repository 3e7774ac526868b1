"""Symmetric FIR filters: zero phase, finite memory, the same result whichever pieces a recording is read in."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d

from .types import Array

Value = TypeVar("Value", bound=np.generic)
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
HALF = 4  # samples that a difference needs on either side


def lowpass(rate: float, cutoff: float, attenuation: float = 60.0) -> Array:
    """Taps of a symmetric Kaiser low-pass, flat up to 0.75 cutoff, stopped from 1.25 cutoff on.

    Args:
        rate: sampling rate [Hz].
        cutoff: frequency of half amplitude [Hz]; at 0.4 rate or above there is nothing to stop.
        attenuation: of the stop band [dB], at least 50.

    Returns:
        An odd number of taps (k,) [1] that sum to 1.

    Source: Kaiser, Nonrecursive digital filter design using the I0-sinh window function, IEEE ISCAS 1974. Written out,
    as importing scipy.signal takes longer than most identifications.
    """
    if cutoff >= 0.4 * rate:
        return np.ones(1)
    count = int(np.ceil((attenuation - 7.95) / (2.285 * np.pi * cutoff / rate) + 1)) | 1
    taps = np.sinc(2 * cutoff / rate * (np.arange(count) - count // 2)) * np.kaiser(count, 0.1102 * (attenuation - 8.7))
    return np.asarray(taps / taps.sum())


def smooth(signal: Array, taps: Array) -> Array:
    """The filtered signal where the taps overlap it fully: (N - k + 1, c).

    Args:
        signal: (N, c) [any unit].
        taps: (k,) [1], symmetric.
    """
    half = len(taps) // 2
    return signal if half == 0 else convolve1d(signal, taps, axis=0, mode="nearest")[half:-half]


def differentiate(signal: Array, period: float) -> tuple[Array, Array]:
    """First and second derivative by nine-point central differences: (N - 8, c) each.

    Args:
        signal: (N, c) [any unit].
        period: sampling period [s].

    Source: Fornberg, Mathematics of Computation 51, 1988, table 1 (eighth order).
    """
    count, terms = len(signal) - 2 * HALF, range(2 * HALF + 1)
    first = sum(FIRST[k] * signal[k : k + count] for k in terms)
    second = sum(SECOND[k] * signal[k : k + count] for k in terms)
    return np.asarray(first) / period, np.asarray(second) / period**2


class Decimator:
    """A symmetric low-pass evaluated at every `factor`-th sample only, many columns at once.

    Blocks of a fixed number of outputs are one product with a banded matrix of fixed shape, so a row's value does
    not depend on which rows are asked for beside it.
    """

    def __init__(self, taps: Array, factor: int) -> None:
        """Band matrix for the filter.

        Args:
            taps: (k,) [1], symmetric, odd count.
            factor: one output every so many samples.
        """
        self.taps, self.factor, self.half = taps, factor, len(taps) // 2
        self.block = int(np.clip(len(taps) // factor, 1, 64))
        self.band = np.zeros((self.block, (self.block - 1) * factor + len(taps)))
        for i in range(self.block):
            self.band[i, i * factor : i * factor + len(taps)] = taps

    def at(self, samples: NDArray[Value]) -> NDArray[Value]:
        """The samples on which outputs are centred, as they are, (M, ...).

        Args:
            samples: (N, ...) [any unit].
        """
        return samples[self.half : len(samples) - self.half : self.factor]

    def __call__(self, columns: Array) -> Array:
        """Outputs (M, c): the first centred on sample `half`, then every `factor`-th while the taps fit.

        Args:
            columns: (N, c) [any unit].
        """
        if len(self.taps) == 1:
            return columns[:: self.factor]
        width = self.band.shape[1]
        total = max(0, (len(columns) - len(self.taps)) // self.factor + 1)
        out = np.empty((total, columns.shape[1]))
        for k in range(0, total, self.block):
            start = k * self.factor
            piece = columns[start : start + width]
            rows = min(self.block, total - k)
            if len(piece) < width:
                piece = np.vstack([piece, np.zeros((width - len(piece), columns.shape[1]))])
            out[k : k + rows] = (self.band @ piece)[:rows]
        return out
