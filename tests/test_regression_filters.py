"""Symmetric filters: gain, derivative, and the same row whatever is asked for beside it."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from signid.regression.bandwidth import HALF, Band, Decimator, differentiate, lowpass, smooth

RATE = 500.0


def test_lowpass_passes_and_stops() -> None:
    taps = lowpass(RATE, 20.0)
    gain = np.abs(np.exp(-2j * np.pi * np.outer([0, 15, 20, 25, 100], np.arange(len(taps))) / RATE) @ taps)
    assert_array_equal(taps, taps[::-1])
    assert_allclose(gain, [1, 1, 0.5, 0, 0], atol=2e-3)


def test_a_cutoff_near_nyquist_filters_nothing() -> None:
    assert_array_equal(lowpass(RATE, 0.4 * RATE), [1.0])


def test_smoothing_keeps_the_phase() -> None:
    t = np.arange(2000) / RATE
    signal = np.sin(2 * np.pi * 3 * t)[:, None]
    taps = lowpass(RATE, 20.0)
    half = len(taps) // 2
    assert_allclose(smooth(signal, taps), signal[half:-half], atol=2e-3)


def test_derivatives_of_a_sine() -> None:
    t, w = np.arange(400) / RATE, 2 * np.pi * 10
    v, a = differentiate(np.sin(w * t)[:, None], 1 / RATE)
    inner = t[HALF:-HALF, None]
    assert_allclose(v, w * np.cos(w * inner), rtol=0, atol=1e-6 * w)
    assert_allclose(a, -(w**2) * np.sin(w * inner), rtol=0, atol=1e-5 * w**2)


def test_white_noise_stays_white_when_thinned() -> None:
    taps = Band(RATE, 10, True, np.ones(1), np.ones(1), np.ones(1)).taps
    folded = [taps[10 * d :] @ taps[: len(taps) - 10 * d] for d in range(5)]
    assert_allclose(folded[1:], 0, atol=2e-3 * folded[0])


def test_decimated_rows_are_the_filtered_ones() -> None:
    x = np.random.default_rng(0).standard_normal((3000, 5))
    taps = lowpass(RATE, 12.0)
    thin = Decimator(taps, 20)
    full = np.stack([np.convolve(column, taps, mode="valid") for column in x.T], axis=1)[::20]
    assert_allclose(thin(x), full, atol=1e-13)


def test_rows_do_not_depend_on_the_window() -> None:
    x = np.random.default_rng(1).standard_normal((20000, 9))
    thin = Decimator(lowpass(RATE, 12.0), 20)
    whole = thin(x)
    step = thin.block * thin.factor
    for first in (step, 7 * step):
        piece = thin(x[first : first + 5000])
        assert_array_equal(piece, whole[first // 20 : first // 20 + len(piece)])
