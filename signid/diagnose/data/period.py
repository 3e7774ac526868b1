"""Positions -> the period with which a motion repeats."""

from __future__ import annotations

import numpy as np

from ...types import Array

LEAST = 1.0  # [s]
SAME = 0.01  # of the positions' spread: difference between one period and the next


def find_period(q: Array, rate: float) -> float | None:
    """The shortest time [s] after which all positions are the same again, None where there is none.

    Args:
        q: (N, n) uniform positions [rad or m].
        rate: of the samples [Hz].
    """
    count, spread = len(q), q.std(0)
    x = (q - q.mean(0))[:, spread > 1e-9] / spread[spread > 1e-9]
    least, most = round(LEAST * rate), int(0.55 * count)
    if x.shape[1] == 0 or most <= least + 2:
        return None
    spectrum = np.fft.rfft(x, 1 << (2 * count).bit_length(), axis=0)
    product = np.fft.irfft(np.sum(np.abs(spectrum) ** 2, axis=1))[:count]
    power = np.append(0.0, np.cumsum(np.sum(x**2, axis=1)))
    lags = np.arange(count)
    square = (power[count - lags] + power[count] - power[lags] - 2 * product) / np.maximum(count - lags, 1) / x.shape[1]
    apart = np.sqrt(np.maximum(square, 0))[least:most]
    lows = np.flatnonzero((apart[1:-1] <= apart[:-2]) & (apart[1:-1] <= apart[2:])) + 1
    good = lows[apart[lows] < SAME]
    return float((good[0] + least) / rate) if len(good) else None
