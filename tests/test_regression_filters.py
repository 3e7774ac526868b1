"""Symmetric filters: gain, derivative, the same row whatever is asked for beside it; least squares without an SVD."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from signid.regression.bandwidth import DIFFERENCE_REACH, Band, Decimator, differentiate, lowpass
from signid.regression.projection import least_squares, leave

RATE = 500.0


def test_lowpass_passes_and_stops() -> None:
    taps = lowpass(RATE, 20.0)
    gain = np.abs(np.exp(-2j * np.pi * np.outer([0, 15, 20, 25, 100], np.arange(len(taps))) / RATE) @ taps)
    assert_array_equal(taps, taps[::-1])
    assert_allclose(gain, [1, 1, 0.5, 0, 0], atol=2e-3)


def test_derivatives_of_a_sine() -> None:
    t, w = np.arange(400) / RATE, 2 * np.pi * 10
    v, a = differentiate(np.sin(w * t)[:, None], 1 / RATE)
    inner = t[DIFFERENCE_REACH:-DIFFERENCE_REACH, None]
    assert_allclose(v, w * np.cos(w * inner), rtol=0, atol=1e-6 * w)
    assert_allclose(a, -(w**2) * np.sin(w * inner), rtol=0, atol=1e-5 * w**2)


def test_white_noise_stays_white_when_thinned() -> None:
    taps = Band(RATE, 10, True, np.ones(1), np.ones(1), np.ones(1)).taps
    folded = [taps[10 * d :] @ taps[: len(taps) - 10 * d] for d in range(5)]
    assert_allclose(folded[1:], 0, atol=2e-3 * folded[0])


def test_rows_do_not_depend_on_the_window() -> None:
    x = np.random.default_rng(1).standard_normal((20000, 9))
    thin = Decimator(lowpass(RATE, 12.0), 20)
    whole = thin(x)
    step = thin.block * thin.factor
    for first in (step, 7 * step):
        piece = thin(x[first : first + 5000])
        assert_array_equal(piece, whole[first // 20 : first // 20 + len(piece)])


COLUMNS = np.random.default_rng(0).normal(size=(30, 4)) @ np.diag([1.0, 1.0, 1.0, 0.0])  # the last shows nothing
TARGET = np.random.default_rng(1).normal(size=(30, 2))


def test_a_singular_value_decomposition_that_does_not_converge_is_done_otherwise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fails(*_: Any, **__: Any) -> None:
        raise np.linalg.LinAlgError("SVD did not converge in Linear Least Squares")

    wanted, rest = least_squares(COLUMNS, TARGET, 1e-9), leave(TARGET, COLUMNS)
    assert wanted[3] == pytest.approx(0)  # the shortest solution
    monkeypatch.setattr(np.linalg, "lstsq", fails)
    assert least_squares(COLUMNS, TARGET, 1e-9) == pytest.approx(wanted, abs=1e-12)
    assert least_squares(COLUMNS[:, :3], TARGET[:, 0]) == pytest.approx(wanted[:3, 0], abs=1e-12)
    assert leave(TARGET, COLUMNS) == pytest.approx(rest, abs=1e-12)
