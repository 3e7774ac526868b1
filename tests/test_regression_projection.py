"""Least squares and projection residuals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from signid.regression.projection import least_squares, leave

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


def test_residuals_are_orthogonal_to_the_columns() -> None:
    rest = leave(TARGET, COLUMNS)
    assert pytest.approx(np.zeros((4, 2)), abs=1e-12) == COLUMNS.T @ rest
