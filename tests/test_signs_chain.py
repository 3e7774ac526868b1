"""Chains of signs: exact against enumeration, and signs restored for a torque whose sign is known."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from signless import Lost, lost

from signid.signs.infer import inflation
from signid.signs.problem import Segment
from signid.signs.samples import expected_signs, likeliest_signs, refine_signs
from signid.types import Array

SEEDS = (0, 1, 2)


def chains(seed: int = 0, length: int = 10, count: int = 3) -> tuple[Array, Array]:
    """Random log-odds of samples and of neighbours, (length, count) each."""
    rng = np.random.default_rng(seed)
    odds, tied = 2 * rng.standard_normal((length, count)), rng.exponential(2, (length, count))
    tied[[0, length // 2]] = 0  # a span begins
    return odds, tied


def enumerated(odds: Array, tied: Array) -> tuple[Array, Array]:
    """Expected and likeliest signs of one chain from all of them."""
    every = np.array(list(product((-1.0, 1.0), repeat=len(odds))))
    score = 0.5 * (every @ odds + (every[:, 1:] * every[:, :-1]) @ tied[1:])
    share = np.exp(score - score.max())
    return share @ every / share.sum(), every[np.argmax(score)]


@pytest.mark.parametrize("seed", SEEDS)
def test_messages_agree_with_enumeration(seed: int) -> None:
    odds, tied = chains(seed)
    expected, best = zip(*(enumerated(o, t) for o, t in zip(odds.T, tied.T, strict=True)), strict=True)
    assert np.abs(expected_signs(odds, tied) - np.array(expected).T).max() < 1e-12
    assert np.array_equal(likeliest_signs(odds, tied), np.array(best).T)


@pytest.mark.parametrize("seed", SEEDS)
def test_signs_below_the_threshold_are_restored(seed: int) -> None:
    case = lost(0.02, seed)
    refined = refine_signs(case.observed, case.value(case.segments()))
    right = refined.signs == np.sign(case.torque)
    small = np.abs(case.torque) < np.quantile(np.abs(case.torque), 0.1, axis=0)
    assert right.mean() > 0.99
    assert right[small].mean() > 0.9
    assert np.abs(refined.expected).max() <= 1
    assert refined.sigma * case.weights == pytest.approx(0.02, rel=0.1)


def impure(case: Lost, joint: int) -> list[Segment]:
    """The segments, the first two neighbours of a joint that differ in sign as one."""
    segments = case.segments()
    own = sorted(s for s in segments if s.joint == joint)
    signs = [np.sign(case.torque[s.start : s.stop, joint].sum()) for s in own]
    k = int(np.flatnonzero(np.diff(signs))[0])
    return [s for s in segments if s not in own[k : k + 2]] + [Segment(joint, own[k].start, own[k + 1].stop)]


@pytest.mark.parametrize("seed", SEEDS)
def test_an_impure_segment_is_mended(seed: int) -> None:
    case = lost(0.02, seed)
    start = case.value(impure(case, 0))
    refined = refine_signs(case.observed, start)
    assert case.misfit(start) > 5 * case.misfit(case.with_signs())
    assert case.misfit(refined.value) < 1.05 * case.misfit(case.with_signs())
    assert np.mean(refined.signs == np.sign(case.torque)) > 0.99


def test_without_noise_parameters_are_exact() -> None:
    case = lost(0.0)
    refined = refine_signs(case.observed, case.value(case.segments()))
    assert refined.value == pytest.approx(case.true, abs=1e-10)
    assert refined.loss < 1e-10
    assert refined.rounds < 12


def test_recorded_signs_stay_and_absent_torques_have_none() -> None:
    case = lost(0.02)
    torque = np.column_stack([case.torque[:, 0], np.abs(case.torque[:, 1]), np.zeros(len(case.torque))])
    mixed = replace(
        case.observed,
        torque=torque,
        signed=np.array([True, False, True]),
        known=np.array([True, True, False]),
    )
    refined = refine_signs(mixed, case.value(case.segments()))
    assert np.array_equal(refined.signs[:, 0], np.sign(case.torque[:, 0]))
    assert np.mean(refined.signs[:, 1] == np.sign(case.torque[:, 1])) > 0.99
    assert not refined.signs[:, 2].any()
    assert refined.sigma[2] == 0


def coloured(memory: float, count: int, seed: int = 0) -> Array:
    """A first-order autoregression."""
    out = np.random.default_rng(seed).standard_normal(count)
    for k in range(1, count):
        out[k] += memory * out[k - 1]
    return out


def test_inflation_of_an_autoregression_is_known() -> None:
    for memory in (0.0, 0.5, 0.8):
        value = inflation(coloured(memory, 40_000), [(0, 40_000)])
        assert value == pytest.approx((1 + memory) / (1 - memory), rel=0.15, abs=0.05)


def test_inflation_is_that_of_short_runs_too() -> None:
    residual = coloured(0.8, 40_000)
    runs = [(k, k + 40) for k in range(0, 40_000, 60)]
    assert inflation(residual, runs) == pytest.approx(9, rel=0.25)
    shuffled = np.random.default_rng(0).permutation(residual)
    assert inflation(shuffled, runs) == pytest.approx(1, abs=0.1)


def test_inflation_is_at_least_one_and_at_most_twice_the_longest_run() -> None:
    assert inflation(np.tile([1.0, -1.0], 50), [(0, 100)]) == 1
    assert inflation(np.zeros(100), [(0, 100)]) == 1
    assert inflation(np.ones(100), []) == 1
    assert inflation(np.full(100, np.nan), [(0, 100)]) == 1
    assert 20 < inflation(np.repeat([1.0, -1.0, 1.0], 20), [(0, 20), (20, 40), (40, 60)]) < 40
