"""Period of a repeated motion."""

from __future__ import annotations

import numpy as np
import pytest

from signid.diagnose.data.noise import find_period
from signid.types import Array


def series(orders: tuple[int, ...], period: float, seconds: float, rate: float, joints: int = 2) -> Array:
    rng, t = np.random.default_rng(7), np.arange(0, seconds, 1 / rate)
    angle = 2 * np.pi / period * t[:, None, None] * np.array(orders)[:, None] + rng.uniform(0, 6, (len(orders), joints))
    return np.asarray(np.sin(angle).sum(1))


@pytest.mark.parametrize(("period", "seconds", "rate"), [(8.0, 16.0, 125.0), (10.0, 45.0, 100.0), (2.5, 20.0, 1000.0)])
def test_a_period_is_found(period: float, seconds: float, rate: float) -> None:
    found = find_period(series((1, 2, 3, 5), period, seconds, rate), rate)
    assert found == pytest.approx(period, abs=1.5 / rate)


@pytest.mark.parametrize("bits", (12, 17))
def test_a_period_is_found_through_encoders_and_noise(bits: int) -> None:
    count, rng = 2 * np.pi / 2**bits, np.random.default_rng(8)
    q = series((1, 2, 3, 5), 8.0, 20.0, 100.0)
    q = np.round((q + 2e-4 * rng.standard_normal(q.shape)) / count) * count + 0.3
    assert find_period(q, 100.0) == pytest.approx(8.0, abs=0.015)


def test_all_joints_must_repeat() -> None:
    one, other = series((1, 2), 4.0, 24.0, 100.0, 1), series((1, 2), 6.0, 24.0, 100.0, 1)
    assert find_period(np.hstack([one, other]), 100.0) == pytest.approx(12.0, abs=0.015)
    assert find_period(np.hstack([one, 0 * other]), 100.0) == pytest.approx(4.0, abs=0.015)  # one stands still


@pytest.mark.parametrize(
    ("name", "q"),
    [
        ("once", series((1, 2, 3, 5), 8.0, 12.0, 100.0)),
        ("never", series((1, 2), 8.0, 40.0, 100.0) + series((1, 2), 8.0 * np.sqrt(2), 40.0, 100.0)),
        ("further every time", series((1, 2), 5.0, 40.0, 100.0) + 0.2 * np.arange(4000)[:, None] / 100),
        ("ever smaller", series((1, 2), 5.0, 40.0, 100.0) * np.exp(-np.arange(4000) / 2000)[:, None]),
        ("at rest", np.full((4000, 2), 0.3)),
        ("short", series((1,), 0.5, 1.0, 100.0)),
        ("ramp", np.arange(4000.0)[:, None]),
    ],
)
def test_no_period_where_there_is_none(name: str, q: Array) -> None:
    assert find_period(q, 100.0) is None, name
