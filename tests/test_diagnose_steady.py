"""Limit of a law's log odds from its gain in parts of the recordings, and the results, on small evidence."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from signid.diagnose.data.dataset import solve
from signid.diagnose.data.noise import _damped
from signid.diagnose.data.rows import Group
from signid.diagnose.findings.alternatives import Contender
from signid.diagnose.findings.findings import _is_vague, _with_held_out
from signid.diagnose.findings.held_out_selection import Extension, _pruned, error_change
from signid.diagnose.holdout import ResidualRows
from signid.diagnose.search.contributions import steadiness
from signid.diagnose.search.shapes import _minimised
from signid.diagnose.thresholds import MAX_AR_ROOT
from signid.effects import EFFECTS
from signid.types import Array, Law

KEY = ("spring", (0,))
SIGN = Law(EFFECTS["torque_sign"], (0,), {})  # has no coefficient that could be vague
COUNT = 800


def steady(torque: Array, rest: Array, prior: float = 0.5) -> float:
    """Log odds of a law with torque (N,) [N.m] and a residual (N,) [N.m] of all laws."""
    group = SimpleNamespace(claim=SimpleNamespace(key=KEY))
    data = SimpleNamespace(rows=lambda _: [0], raw=lambda *_: torque[:, None])
    posterior = SimpleNamespace(evidence=SimpleNamespace(data=data), priors={KEY: float(np.log(prior))})
    contributions = SimpleNamespace(coefficients=_Always(np.ones(1)))
    return steadiness(cast(Any, posterior), cast(Any, contributions), rest[:, None], cast(Any, group))


class _Always:
    """One value for all keys."""

    def __init__(self, value: Array) -> None:
        self.value = value

    def __getitem__(self, _: object) -> Array:
        return self.value


def noise(seed: int, size: float = 0.1) -> Array:
    return size * np.random.default_rng(seed).standard_normal(COUNT)


def test_a_law_with_even_gain_may_be_certain() -> None:
    assert steady(np.sin(np.arange(COUNT) / 9.0), noise(0)) > 20


def test_a_law_with_uneven_gain_is_uncertain() -> None:
    torque = np.sin(np.arange(COUNT) / 9.0)
    half = np.arange(COUNT) < COUNT / 2
    imitated = np.where(half, 0.9, -0.9) * torque + noise(1)  # there at twice the size, then not at all
    assert steady(torque, imitated) < 3


def test_a_law_acts_where_its_joint_moves() -> None:
    torque = np.sin(np.arange(COUNT) / 9.0) * (np.arange(COUNT) < COUNT / 5)
    assert steady(torque, noise(2)) > 10  # blocks hold as much of its torque each, however long that takes


def test_few_rows_of_large_torque_suffice_where_each_gains_alike() -> None:
    torque = np.zeros(COUNT)
    torque[[100, 300, 500, 700, 720]] = [2.0, 5.0, 6.0, 2.5, 0.8]  # a limited command, at reversals
    assert steady(torque, noise(2)) > 7
    imitated = torque * ([*[0.0] * 400, *[2.0] * 400]) + noise(2)  # the law makes too much of it in half of the rows
    assert steady(torque, imitated) < 3


def test_rare_laws_need_more() -> None:
    torque = np.sin(np.arange(COUNT) / 9.0)
    assert steady(torque, noise(3), 0.5) - steady(torque, noise(3), 0.005) == pytest.approx(np.log(100))


def rows(rest: Array) -> ResidualRows:
    """Rows (N, n) [N.m] of 1 N.m of torque."""
    first = np.zeros(len(rest), dtype=np.intp)
    still = np.zeros_like(rest)
    return ResidualRows((), cast(Any, None), first, first, 1.0 * first, still, still, rest, 1.0 + still, still)


def test_joints_that_are_predicted_worse_weigh_more() -> None:
    before = np.column_stack([noise(4), noise(5)])
    better, worse = before * [0.5, 1.0], before * [0.5, 1.3]
    assert error_change(rows(before), rows(before)) == 0
    assert error_change(rows(better), rows(before)) < -1
    assert error_change(rows(worse), rows(before)) > error_change(rows(better), rows(before)) + 4 * np.log(1.3)


def test_held_coefficients_stay_zero() -> None:
    rng = np.random.default_rng(6)
    x, truth = rng.standard_normal((200, 3)), np.array([1.0, -2.0, 0.5])
    fit = solve(np.arange(3), x.T @ x, x.T @ (x @ truth), 1e-9 * np.eye(3))
    np.testing.assert_allclose(fit.value, truth, rtol=1e-6)
    free = np.array([True, False, True])
    held = fit.restricted(free).value
    np.testing.assert_allclose(held[free], np.linalg.lstsq(x[:, free], x @ truth, rcond=None)[0], rtol=1e-6)
    assert abs(held[1]) < 1e-12


def test_noise_decays() -> None:
    slow = np.array([1.7, -0.9, 0.3, -0.1])
    roots = np.abs(np.roots(np.append(1.0, -_damped(slow))))
    assert roots.max() == pytest.approx(MAX_AR_ROOT)
    fast = np.array([0.5, -0.1, 0.0, 0.0])
    np.testing.assert_array_equal(_damped(fast), fast)


@pytest.mark.parametrize(
    ("kept", "itself", "likely"), [(True, False, 0.999), (False, False, 0.5), (False, True, 0.999)]
)
def test_a_pruned_law_has_at_most_even_odds(kept: bool, itself: bool, likely: float) -> None:
    group = Group(0, 1, cast(Any, SimpleNamespace(key=KEY)))
    contender = Contender(group, evidence=9.2, shares={KEY: 1.0}, candidates={}, unexplained=0.0)
    extended = SimpleNamespace(kept={group} if kept else set(), log_bayes={group: 0.0}, laws={group: (SIGN,)})
    after = _with_held_out(contender, cast(Any, extended), {group: [{}]}, itself)
    assert after.probability == pytest.approx(likely, abs=0.001)


def test_a_law_that_does_not_act_on_held_out_rows_stays() -> None:
    group = Group(0, 1, cast(Any, SimpleNamespace(key=KEY, laws=(SIGN,))))
    rest = noise(7)[:, None]

    class _Trials:
        session = SimpleNamespace(judges_itself=False)

        def held_out(self, extension: Extension) -> ResidualRows:
            return rows(rest)

    kept, scores = _pruned(cast(Any, _Trials()), Extension((group,)), {})
    assert kept.kept == (group,) and not scores[group].tested and scores[group].log_bayes == 0


@pytest.mark.parametrize(("tolerated", "stays"), [(0.0, False), (0.1, True)])
def test_a_law_that_refitted_numbers_can_replace_stays(tolerated: float, stays: bool) -> None:
    group = Group(0, 1, cast(Any, SimpleNamespace(key=KEY, laws=(SIGN,))))

    class _Trials:
        session = SimpleNamespace(judges_itself=False)

        def held_out(self, extension: Extension) -> ResidualRows:
            return rows(noise(8)[:, None] * (1.005 if group in extension.kept else 1.0))

    kept, _ = _pruned(cast(Any, _Trials()), Extension((group,)), {}, tolerated)
    assert (kept.kept == (group,)) == stays


@pytest.mark.parametrize(("best", "further", "found"), [(0.4, 0, 0.4), (2.5, 0, 1.0), (2.5, 4, 2.5), (-2.5, 4, -1.0)])
def test_sizes_of_recording_laws_are_searched_outwards(best: float, further: int, found: float) -> None:
    steps = _minimised(lambda x: float((x[0] - best) ** 2), np.zeros(1), 20, further)
    assert steps.x[0] == pytest.approx(found, abs=0.02)


@pytest.mark.parametrize(("error", "std", "vague"), [(0.002, 0.04, True), (0.03, 0.04, False), (0.002, 0.0, False)])
def test_a_law_with_insignificant_coefficients_is_vague(error: float, std: float, vague: bool) -> None:
    assert _is_vague(Law(EFFECTS["torque_gain"], (0,), {"error": error}), {"error": std}) == vague
    assert not _is_vague(SIGN, {})
