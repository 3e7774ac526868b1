"""Strongest sine of a signal, and the period of a motion: a periodic disturbance is no noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...regression.projection import least_squares
from ...types import Array

PERIOD_TOLERANCE = 0.01  # [1] rms difference of two periods, over the standard deviation of positions. Heuristic
MIN_CYCLES = 3.0  # [1] cycles in the signal, at least: a slower sine is drift. Heuristic
OVERSAMPLING = 16  # frequencies of the periodogram for each that the length resolves. Heuristic
MIN_SAMPLES = 32  # samples; in a shorter signal no sine is sought. Heuristic
MIN_PERIOD = 1.0  # [s] shortest period of a motion. Heuristic
MAX_PERIOD = 0.55  # [1] longest period, as a share of the recording: nearly two periods are compared. Heuristic


class Wave(NamedTuple):
    """A sine that was fitted to a signal."""

    frequency: float  # [Hz]
    signal: Array  # (N,) [unit of the signal] the sine
    share: float  # share of the signal's sum of squares [1]


def find_wave(x: Array, rate: float) -> Wave:
    """Fit a sine to x (N,) [any unit]: frequency at the peak of an oversampled periodogram, size by least squares.

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
    peak = k + ((before - after) / bend / 2 if bend < 0 else 0.0)  # vertex of the parabola through three points
    frequency = peak * rate / (OVERSAMPLING * len(x))
    angle = 2 * np.pi * frequency / rate * np.arange(len(x))
    columns = np.column_stack([np.cos(angle), np.sin(angle)])
    signal = np.asarray(columns @ least_squares(columns, x))
    return Wave(frequency, signal, float(signal @ signal) / whole)


def find_period(q: Array, rate: float) -> float | None:
    """Shortest period [s] after which all uniformly sampled positions q (N, n) [rad or m] repeat; None if none does."""
    count, spread = len(q), q.std(0)
    x = (q - q.mean(0))[:, spread > 1e-9] / spread[spread > 1e-9]
    least, most = round(MIN_PERIOD * rate), int(MAX_PERIOD * count)
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
