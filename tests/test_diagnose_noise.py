"""Noise of a residual, period of a repeated motion, and descriptions of where torque occurs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from signid.diagnose.data.hypotheses import hats
from signid.diagnose.data.locate import find_wave, locate
from signid.diagnose.data.noise import find_period, measure_noise, weights, whiten
from signid.diagnose.data.rows import Group, RowTable, _holding_torque, _pushed
from signid.diagnose.thresholds import MIN_MOVING_ROWS, REPLICATE_FACTOR, STATIC_OVER_DRY
from signid.types import Array

RATE = 20.0  # Hz
AR = np.array([1.1, -0.5, 0.2, -0.1])  # of the last four values, stable
KEEP = Group(0, 3, deviation=(np.inf,) * 3)


def table(residual: Array, columns: Array, pieces: int = 1, rests: Array | None = None, **signals: Array) -> RowTable:
    """Rows of one joint."""
    count = len(residual)
    piece = np.arange(count) * pieces // count
    usual = {name: np.zeros((count, 1)) for name in ("q", "v", "a", "torque", "predicted")}
    still = np.zeros((count, 1), dtype=bool) if rests is None else rests[:, None]
    t = signals.pop("t", np.arange(count) / RATE)
    given = {name: x[:, None] for name, x in signals.items()}
    groups = (KEEP,) if columns.shape[1] == 3 else (Group(0, columns.shape[1], deviation=(np.inf,)),)
    place = (np.arange(columns.shape[1]),)
    whole = {**usual, **given}
    return RowTable(
        groups,
        columns.shape[1],
        piece,
        piece,
        t,
        whole["q"],
        whole["v"],
        whole["a"],
        whole["torque"],
        whole["predicted"],
        residual[:, None],
        still,
        np.zeros((count, 1)),
        place,
        (columns,),
    )


def coloured(count: int, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return np.asarray(lfilter([1.0], np.r_[1.0, -AR], rng.standard_normal(count + 200))[200:])


def waves(count: int, seed: int = 9) -> Array:
    """(N, 3) columns of a motion that never repeats."""
    w = np.array([0.31, 0.77, 1.3]) * (1 + 0.1 * seed)
    return np.sin(np.arange(count)[:, None] / RATE * w)


def test_correlation_and_size_are_those_of_the_noise() -> None:
    noise, columns = 0.3 * coloured(12000, 1), waves(12000)
    found = measure_noise(table(noise + columns @ [1.0, -2.0, 0.5], columns), [None], RATE)
    np.testing.assert_allclose(found.coefficients[0], AR, atol=0.04)
    assert found.innovation[0] == pytest.approx(0.3, rel=0.03)
    assert found.floor[0] == pytest.approx(noise.std(), rel=0.03)
    white = whiten(noise[:, None], found.coefficients[0], float(found.innovation[0]), np.zeros(12000, dtype=np.intp))
    assert len(white) == 12000 - 4 and white.std() == pytest.approx(1, rel=0.04)
    own = white[:, 0] / white.std()
    for lag in range(1, 8):
        assert abs(np.mean(own[lag:] * own[:-lag])) < 4 / np.sqrt(len(own))


def test_many_columns_do_not_make_noise_look_small() -> None:
    rng, count = np.random.default_rng(2), 600
    columns, noise = rng.standard_normal((count, 150)), coloured(count, 3)
    found = measure_noise(table(noise, columns), [None], RATE)
    assert found.floor[0] == pytest.approx(noise.std(), rel=0.15)


def test_no_filter_crosses_the_end_of_a_piece() -> None:
    x, piece = np.arange(20.0)[:, None], np.repeat([0, 1], 10)
    out = whiten(x, np.array([1.0, 0.0, 0.0, 0.0]), 2.0, piece)
    np.testing.assert_array_equal(out[:, 0], np.full(12, 0.5))
    steps = np.where(piece == 0, 0.0, 1e6)[:, None]
    assert not whiten(steps, np.array([1.0, 0.0, 0.0, 0.0]), 1.0, piece).any()


def test_repetitions_separate_noise_from_physics() -> None:
    count, period = 4000, 10.0
    rng, phase = np.random.default_rng(4), np.arange(count) / RATE * 2 * np.pi / period
    physics, noise = np.sign(np.sin(7 * phase + 0.1)) + np.cos(11 * phase), 0.1 * rng.standard_normal(count)
    rows = table(physics + noise, waves(count), pieces=2)
    alone, again = (measure_noise(rows, periods, RATE) for periods in ([None, None], [period, period]))
    assert alone.floor[0] > 0.5 and again.floor[0] == pytest.approx(0.1 * REPLICATE_FACTOR, rel=0.08)
    one = measure_noise(rows, [period, None], RATE)  # one of two recordings repeats
    assert one.floor[0] == pytest.approx(0.1 * REPLICATE_FACTOR, rel=0.1)


def test_a_contact_in_one_period_is_no_noise() -> None:
    count, period = 4000, 10.0
    rng, t = np.random.default_rng(5), np.arange(count) / RATE
    noise = 0.1 * rng.standard_normal(count) + 3.0 * ((t > 33) & (t < 36))
    found = measure_noise(table(noise, waves(count), pieces=2), [period, period], RATE)
    assert found.floor[0] == pytest.approx(0.1 * REPLICATE_FACTOR, rel=0.1)


def test_friction_at_rest_is_no_noise() -> None:
    count = 4000
    noise, rests = 0.1 * np.random.default_rng(6).standard_normal(count), np.arange(count) % 400 < 100
    found = measure_noise(table(noise + 5.0 * rests, waves(count), rests=rests), [None], RATE)
    assert found.floor[0] == pytest.approx(0.1, rel=0.08)


@pytest.mark.parametrize("size", [0.3, 3.0])
def test_a_wave_in_time_is_no_noise(size: float) -> None:
    rng, t = np.random.default_rng(8), np.arange(1200) / RATE
    noise, wave = 0.1 * rng.standard_normal(len(t)), size * np.sin(2 * np.pi * 1.37 * t + 0.4)
    rows = table(noise + wave, waves(len(t)), pieces=2)
    assert measure_noise(rows, [None, None], RATE).floor[0] == pytest.approx(0.1, rel=0.1)
    place = locate(rows, 0, rows.residual[:, 0])
    assert (place.variable, place.region) == ("time", "at 1.37 Hz") and place.share > 0.8


def test_noise_has_no_wave() -> None:
    shares = [find_wave(coloured(1000, seed), RATE).share for seed in range(20)]
    assert max(shares) < 0.1
    assert find_wave(np.zeros(100), RATE).share == 0 and find_wave(np.ones(5), RATE).share == 0


def test_torque_is_less_certain_near_reversals() -> None:
    count = 4000
    rng, near = np.random.default_rng(9), np.arange(count) % 40 < 6
    residual = 0.1 * rng.standard_normal(count) + 0.5 * near * rng.standard_normal(count)
    rows = replace(table(residual, waves(count)), reversal_std=0.5 * near[:, None])
    noise = measure_noise(rows, [None], RATE)
    assert noise.floor[0] == pytest.approx(0.1, rel=0.1)
    weight = weights(rows, noise)[:, 0]
    assert weight[near[4:]].max() < 0.3 and np.mean(weight > 0.9) > 0.6
    white = whiten(rows.residual, noise.coefficients[0], float(noise.innovation[0]), rows.piece)[:, 0] * weight
    assert 0.8 < np.mean(white**2) < 1.2


def test_a_residual_without_noise_has_a_floor() -> None:
    found = measure_noise(table(np.zeros(500), waves(500)), [None], RATE)
    assert 0 < found.floor[0] < 1e-9 and 0 < found.innovation[0] < 1e-9 and np.isfinite(found.coefficients).all()


COUNT = 4000
RANDOM = np.random.default_rng(11)
SIGNALS = {name: size * RANDOM.standard_normal(COUNT) for name, size in (("q", 1.0), ("v", 0.8), ("a", 3.0))}
SIGNALS["predicted"] = 5 * RANDOM.standard_normal(COUNT)
T = np.arange(COUNT) / RATE


@pytest.mark.parametrize(
    ("variable", "region", "torque"),
    [
        ("velocity", "slower than 0.1 rad/s", lambda s: np.abs(s["v"]) < 0.1),
        ("velocity", "faster than 1 rad/s", lambda s: np.abs(s["v"]) * s["v"] * (np.abs(s["v"]) > 1.03)),
        ("velocity", "above 0 rad/s", lambda s: 1.0 * (s["v"] > 0)),
        ("velocity", "below 0 rad/s", lambda s: 1.0 * (s["v"] < 0)),
        ("acceleration", "beyond 3.9 rad/s2", lambda s: s["a"] * (np.abs(s["a"]) > 3.84)),
        ("torque", "beyond 6.4 N.m", lambda s: np.abs(s["predicted"]) * (np.abs(s["predicted"]) > 6.4)),
        ("position", "0.84", lambda s: 1.0 * (s["q"] > 0.84)),
        ("time", "100 to 120 s", lambda s: 1.0 * ((T >= 100) & (T < 120))),
    ],
)
def test_planted_torque_is_located(variable: str, region: str, torque: Callable[[dict[str, Array]], Array]) -> None:
    own = np.asarray(torque(SIGNALS), dtype=float)
    noise = 0.03 * np.sqrt(np.mean(own**2)) * RANDOM.standard_normal(COUNT)
    place = locate(table(own, waves(COUNT), t=T, **SIGNALS), 0, own + noise)
    assert (place.joint, place.variable) == (0, variable)
    words = place.region.split()
    if variable in ("position", "time"):
        low, high = float(words[0]), float(words[2])
        wanted = (100, 120) if variable == "time" else (0.84, SIGNALS["q"].max())
        assert low == pytest.approx(wanted[0], abs=0.02) and high == pytest.approx(wanted[1], rel=0.01)
    else:
        assert words[:-2] == region.split()[:-2] and words[-1] == region.split()[-1]
        assert float(words[-2]) == pytest.approx(float(region.split()[-2]), rel=0.25)
    assert place.share > 0.8 and 0.5 < place.explained <= 1


def test_a_sliding_joint_is_described_in_metres() -> None:
    own = SIGNALS["v"] * (np.abs(SIGNALS["v"]) > 1)
    rows = table(own, waves(COUNT), t=T, **SIGNALS)
    assert locate(rows, 0, own).region.endswith("rad/s") and locate(rows, 0, own, prismatic=True).region.endswith(
        " m/s"
    )
    load = SIGNALS["predicted"] * (np.abs(SIGNALS["predicted"]) > 6)
    assert locate(rows, 0, load, prismatic=True).region.endswith(" N")


def test_noise_depends_on_nothing() -> None:
    noise = RANDOM.standard_normal(COUNT)
    place = locate(table(noise, waves(COUNT), t=T, **SIGNALS), 0, noise)
    assert place.explained < 0.02 and place.share < 0.7
    assert locate(table(0 * noise, waves(COUNT), t=T, **SIGNALS), 0, 0 * noise).share == 0


def test_hats_make_any_piecewise_linear_function() -> None:
    x, knots = np.linspace(-2, 3, 200), [-1.0, 0.0, 0.5, 2.0]
    columns = np.column_stack([np.ones(200), hats(x, knots)])
    wanted = np.interp(x, knots, [3.0, -1.0, 0.5, 2.0])
    assert columns.shape == (200, 4)
    assert np.linalg.norm(wanted - columns @ np.linalg.lstsq(columns, wanted, rcond=None)[0]) < 1e-12


def test_a_joint_at_rest_under_more_torque_than_friction_holds_is_no_rest() -> None:
    rests = np.zeros((200, 2), dtype=bool)
    rests[20:40], rests[90:120] = True, True
    residual = np.where(rests, 0.1, 0.2)
    residual[30, 0], residual[100, 1] = 3.0, 0.3  # a limited command; static friction
    held = _holding_torque(residual, rests, np.array([0.1, 0.1]))
    assert held == pytest.approx([STATIC_OVER_DRY * 0.3] * 2)
    pushed = _pushed(rests, residual, held)
    assert pushed[20:40, 0].all() and not pushed[90:120].any() and not pushed[:, 1].any() and pushed.sum() == 20


def test_what_friction_holds_is_unknown_of_a_joint_that_hardly_moves() -> None:
    rests = np.ones((200, 1), dtype=bool)
    rests[:MIN_MOVING_ROWS] = False
    assert np.isinf(_holding_torque(np.ones((200, 1)), rests, np.zeros(1))).all()


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
