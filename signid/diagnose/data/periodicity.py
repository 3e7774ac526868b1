"""A signal -> the wave in time that takes most of it: a disturbance that has a frequency is no noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...regression.projection import least_squares
from ...types import Array
from .thresholds import PERIOD_TOLERANCE

MIN_CYCLES = 3.0  # at least: what is slower is drift
OVERSAMPLING = 16  # frequencies tried for each that the length resolves
MIN_SAMPLES = 32  # samples: too few


MIN_PERIOD = 1.0  # [s]


class Wave(NamedTuple):
    """One sine of a signal."""

    frequency: float  # [Hz]
    signal: Array  # (N,) [as the signal]
    share: float  # of the signal's sum of squares [1]


def find_wave(x: Array, rate: float) -> Wave:
    """The likeliest sine, its frequency from a fine periodogram, its size by least squares.

    Args:
        x: (N,) [any unit].
        rate: [Hz].

    Source: Schuster's periodogram, as in Stoica, Moses, Spectral Analysis of Signals, 2005, section 4.3.
    """
    whole = float(x @ x)
    if len(x) < MIN_SAMPLES or whole == 0:
        return Wave(0.0, np.zeros_like(x), 0.0)
    lowest = int(MIN_CYCLES * OVERSAMPLING)
    power = np.abs(np.fft.rfft(x, OVERSAMPLING * len(x))) ** 2
    k = lowest + int(np.argmax(power[lowest:-1]))
    before, here, after = power[k - 1 : k + 2].tolist()
    bend = before - 2 * here + after
    peak = k + ((before - after) / bend / 2 if bend < 0 else 0.0)  # of the parabola through three
    frequency = peak * rate / (OVERSAMPLING * len(x))
    angle = 2 * np.pi * frequency / rate * np.arange(len(x))
    columns = np.column_stack([np.cos(angle), np.sin(angle)])
    signal = np.asarray(columns @ least_squares(columns, x))
    return Wave(frequency, signal, float(signal @ signal) / whole)


def find_period(q: Array, rate: float) -> float | None:
    """The shortest time [s] after which all positions are the same again, None where there is none.

    Args:
        q: (N, n) uniform positions [rad or m].
        rate: of the samples [Hz].
    """
    count, spread = len(q), q.std(0)
    x = (q - q.mean(0))[:, spread > 1e-9] / spread[spread > 1e-9]
    least, most = round(MIN_PERIOD * rate), int(0.55 * count)
    if x.shape[1] == 0 or most <= least + 2:
        return None
    spectrum = np.fft.rfft(x, 1 << (2 * count).bit_length(), axis=0)
    product = np.fft.irfft(np.sum(np.abs(spectrum) ** 2, axis=1))[:count]
    power = np.append(0.0, np.cumsum(np.sum(x**2, axis=1)))
    lags = np.arange(count)
    square = (power[count - lags] + power[count] - power[lags] - 2 * product) / np.maximum(count - lags, 1) / x.shape[1]
    apart = np.sqrt(np.maximum(square, 0))[least:most]
    lows = np.flatnonzero((apart[1:-1] <= apart[:-2]) & (apart[1:-1] <= apart[2:])) + 1
    good = lows[apart[lows] < PERIOD_TOLERANCE]
    return float((good[0] + least) / rate) if len(good) else None
