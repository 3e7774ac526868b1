"""Pendulum in Bullet: physics of the simulation, identification with and without torque signs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

pytest.importorskip("pybullet", reason="PyBullet is not installed; pip install 'signid[bench]'")

from benchmarks.pendulum import (  # noqa: E402  # noqa: E402  # noqa: E402
    FUNDAMENTAL,
    KEPT,
    LOGS,
    PERIOD,
    QUANTILE,
    SEARCHED,
    STEP,
    TRUTH,
    WAYS,
    Pendulum,
    Track,
    estimate,
    log,
    predict,
    read_log,
    record,
    restore,
    search,
    segments,
    smooth,
)
from signid.robot import load_robot  # noqa: E402

GRAVITY, INERTIA = TRUTH
SEED = 1  # a motion with 16 segments


@pytest.fixture(scope="module")
def pendulum() -> Iterator[Pendulum]:
    swinging = Pendulum()
    yield swinging
    swinging.close()


@pytest.fixture(scope="module")
def true(pendulum: Pendulum) -> Track:
    return record(pendulum, SEED)


def test_bullet_has_the_inertia_of_the_urdf(pendulum: Pendulum) -> None:
    assert pendulum.truth == pytest.approx(TRUTH, rel=1e-12)


def test_every_step_obeys_the_equation_of_motion(pendulum: Pendulum) -> None:
    """Torque of step k moves the pendulum from k to k + 1; the second difference about k is its acceleration."""
    t = np.arange(0, 4, STEP)
    track = pendulum.swing(1.2 * np.sin(6 * t), 7.2 * np.cos(6 * t))
    acceleration = np.diff(track.q, 2) / STEP**2
    assert np.abs(track.tau).max() > 20
    assert acceleration * INERTIA + GRAVITY * np.sin(track.q[1:-1]) == pytest.approx(track.tau[1:-1], abs=1e-6)


def test_free_swing_matches_the_analytic_pendulum() -> None:
    """From rest at 2 rad for 20 s: no energy is lost; the integration error decreases with the step."""
    sine, w = np.sin(1.0), np.sqrt(GRAVITY / INERTIA)
    for step in (1e-3, 2.5e-4):
        swinging = Pendulum(step)
        t = np.arange(0, 20, step)
        q = swinging.swing(np.full_like(t, 2.0), np.zeros_like(t), stiffness=0.0, damping=0.0).q
        swinging.close()
        exact = 2 * np.arcsin(sine * ellipj(w * t + ellipk(sine**2), sine**2)[0])
        assert np.abs(q - exact).max() < 4 * step
        energy = INERTIA * (np.diff(q) / step) ** 2 / 2 - GRAVITY * np.cos((q[1:] + q[:-1]) / 2)
        assert np.ptp(energy) < 1e-5 * GRAVITY * (step / 1e-3) ** 2 + 1e-7 * GRAVITY


def test_the_filter_halves_its_corner_without_delay() -> None:
    t = np.arange(0, 50, PERIOD)
    for corner in filter(None, WAYS.values()):
        wave = np.sin(2 * np.pi * corner * t)
        assert smooth(wave, corner)[KEPT] == pytest.approx(wave[KEPT] / 2, abs=1e-3)
        assert smooth(np.sin(np.pi * corner * t), corner)[KEPT] == pytest.approx(
            np.sin(np.pi * corner * t)[KEPT], abs=1e-3
        )


@pytest.mark.parametrize("way", WAYS)
def test_coefficients_are_identified_with_and_without_signs(true: Track, way: str) -> None:
    """With 17 bits and 2 % noise: m g d to 0.3 %, I + m d2 to 2 %."""
    robot, logged = load_robot("1r"), log(true, SEED)
    restored, signs = restore(logged, true)
    assert signs.segments == signs.right == SEARCHED
    assert signs.mixed == 0
    assert signs.away == 100
    assert signs.samples > 99.5
    for track in (logged, restored):
        value, std = estimate(robot, track, WAYS[way])
        assert (np.abs(value / TRUTH - 1) < [0.003, 0.02]).all(), value
        assert (std > 0).all()


def test_bias_of_each_method_without_noise(true: Track) -> None:
    """Central differences overestimate inertia by 0.1 %; nine-point differences do not."""
    robot, clean = load_robot("1r"), log(true, SEED, bits=40, noise=0.0)
    off = {way: abs(estimate(robot, clean, corner)[0][1] / INERTIA - 1) for way, corner in WAYS.items()}
    assert off["signid's own"] < 1e-4
    assert all(5e-4 < off[way] < 3e-3 for way, corner in WAYS.items() if corner)


def test_the_best_signs_match_a_plain_search() -> None:
    """Compare with least squares for each choice of signs; the overall sign makes inertia positive."""
    rng = np.random.default_rng(3)
    columns, spans = rng.standard_normal((60, 2)), [slice(k, k + 12) for k in range(0, 60, 12)]
    sign = np.repeat([1.0, -1.0, -1.0, 1.0, -1.0], 12)
    magnitude = sign * (columns @ [2.0, -1.5]) + 0.3 * rng.standard_normal(60)
    residuals = {}
    for k in range(32):
        signs = np.array([1.0 if k >> i & 1 else -1.0 for i in range(5)])
        wanted = np.repeat(signs, 12) * magnitude
        value = np.linalg.lstsq(columns, wanted, rcond=None)[0]
        if value[1] > 0:
            residuals[tuple(signs)] = float(np.sqrt(np.mean((wanted - columns @ value) ** 2))), tuple(value)
    got = search(columns, magnitude, spans)
    (first, rms), (_, following) = sorted(residuals.items(), key=lambda item: item[1])[:2]
    assert tuple(got.signs) == first == (-1, 1, 1, -1, 1)
    assert (got.rms, got.next_rms) == pytest.approx((rms[0], following[0]))
    assert got.value == pytest.approx(rms[1])


def test_segments_are_the_longest_runs_above_the_quantile() -> None:
    t = np.arange(0, 3 / FUNDAMENTAL, PERIOD)
    magnitude = np.abs(np.sin(2 * np.pi * t))  # 60 half waves
    spans = segments(magnitude)
    assert len(spans) == SEARCHED
    assert all(magnitude[span].min() > np.quantile(magnitude, QUANTILE) for span in spans)
    assert sorted(spans, key=lambda span: span.start) == spans


def test_wrong_coefficients_predict_wrong_signs(true: Track) -> None:
    """Signs from wrong coefficients are wrong above the quantile as well."""
    columns = np.column_stack([np.sin(true.q), np.gradient(np.gradient(true.q, PERIOD), PERIOD)])[KEPT]
    wrong = predict(columns, TRUTH * [1, -1]) != np.sign(true.tau[KEPT])
    assert wrong.mean() > 0.05
    assert (predict(columns, TRUTH) == np.sign(true.tau[KEPT])).mean() > 0.995


@pytest.mark.parametrize("name", LOGS)
def test_recorded_magnitudes_give_coefficients_and_signs(data: Path, name: str) -> None:
    value, signs = read_log(data / "seed_penne" / f"{name}.csv.gz")
    assert value == pytest.approx(TRUTH, abs=1e-6)
    assert signs.holds
    assert signs.mixed == 0
