"""Physically consistent standard parameters: base parameters kept where possible, else moved little, and certified."""

from __future__ import annotations

import warnings
from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from captured import Captured, captured
from numpy.testing import assert_allclose

from signid.estimation import feasible as solver
from signid.estimation.feasible import ConsistentFit, feasible_prior, fit_consistent, inertial, pack, standard_from_base
from signid.types import Estimate, pseudo_inertia


def fitted(case: Captured) -> ConsistentFit:
    return fit_consistent(case.base, case.estimate, case.prior)


def least_chi2(case: Captured) -> float:
    """Least chi2 of feasible parameters, by a formulation without prior, barrier or Newton's method."""
    x = cp.Variable(len(case.base.labels))
    root = solver.information_root(case.estimate.information)
    basis = np.array([pseudo_inertia(e) for e in np.eye(10)]).reshape(10, 16).T
    bodies = [
        cp.reshape(basis @ x[i : i + 10], (4, 4), order="C") >> 0 for i in range(0, inertial(case.prior).sum(), 10)
    ]
    signs = [x[i] >= 0 for i, label in enumerate(case.base.labels) if label.positive]
    away = root @ case.base.combination @ x - root @ case.estimate.value
    problem = cp.Problem(cp.Minimize(cp.sum_squares(away)), bodies + signs)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        problem.solve(solver=cp.CLARABEL)
    return float(problem.value)


def moved_to(case: Captured, name: str, value: float) -> Captured:
    """The same case with another estimate of one coefficient."""
    where = next(i for i, k in enumerate(case.base.independent) if case.base.labels[k].name == name)
    changed = case.estimate.value.copy()
    changed[where] = value
    return replace(case, estimate=replace(case.estimate, value=changed))


def test_noise_free_base_parameters_are_kept() -> None:
    for name in ("1r", "3r"):
        case = captured(name, noise=1e-9)
        fit = fitted(case)
        assert fit.feasible_without_moving and fit.parameters.is_feasible() and not fit.notes
        assert_allclose(fit.base_value, case.estimate.value, rtol=0, atol=1e-9 * np.abs(case.estimate.value).max())
        assert fit.moved < 0.01


@pytest.mark.parametrize("seed", range(6))
def test_noisy_consistent_base_parameters_are_kept(seed: int) -> None:
    case = captured("3r", noise=0.03, seed=seed)
    fit, least = fitted(case), least_chi2(case)
    assert fit.parameters.is_feasible()
    assert least - 1e-6 <= fit.chi2 <= least + 0.5
    if fit.feasible_without_moving:
        assert fit.moved < 2e-3 and least < 1e-6
    elif least < 1e-6:  # only bodies a thousand times heavier than stated would reproduce it
        assert fit.moved < 0.5


def test_reported_values_are_consistent() -> None:
    for case in (captured("3r", 0.1), moved_to(captured("3r", 0.1), "coulomb_friction_2", -0.5)):
        fit = fitted(case)
        away = fit.base_value - case.estimate.value
        assert_allclose(fit.base_value, case.base.combination @ fit.parameters.values, rtol=0, atol=0)
        assert_allclose(fit.chi2, away @ case.estimate.information @ away)
        assert_allclose(fit.moves, away / case.estimate.std)
        assert fit.moved == np.abs(fit.moves).max()


def test_negative_friction_moves_to_zero_by_the_least_change() -> None:
    kept = captured("3r", noise=0.01, seed=1)
    assert fitted(kept).feasible_without_moving
    case = moved_to(kept, "coulomb_friction_2", -0.05)
    fit = fitted(case)
    i = [label.name for label in case.base.labels].index("coulomb_friction_2")
    assert 0 <= fit.parameters.values[i] < 0.1 * case.estimate.std.max()
    assert not fit.feasible_without_moving and fit.moved > 1
    assert fit.chi2 < 1.05 * least_chi2(case)


def test_a_failing_solver_only_adds_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    case = captured("3r", noise=0.05)
    well = fitted(case)
    monkeypatch.setattr(solver, "trace_path", lambda problem, heavier: None)
    by_solver = fitted(case)
    assert not by_solver.notes
    assert_allclose(by_solver.parameters.values, well.parameters.values, rtol=1e-6, atol=1e-9)
    monkeypatch.setattr(solver, "_solve_interior", lambda problem: (None, "failed"))
    alone = fitted(case)
    assert alone.parameters.is_feasible() and "Newton" in alone.notes[-1]
    assert_allclose(alone.chi2, well.chi2, rtol=1e-6)


def test_solver_answers_are_verified(monkeypatch: pytest.MonkeyPatch) -> None:
    case = captured("3r", noise=0.05)
    u = solver.build_feasible(case.base, case.estimate, case.prior, 1e-2).start
    u[:10] = pack(np.diag([1.0, 1.0, -1e-9, 1.0]))
    monkeypatch.setattr(solver, "trace_path", lambda problem, heavier: None)
    monkeypatch.setattr(cp.Problem, "solve", lambda problem, **_: setattr(problem.variables()[0], "value", u))
    fit = fitted(case)
    assert fit.parameters.is_feasible() and "without a feasible point" in fit.notes[-1]


def test_massless_flat_and_impossible_bodies_of_the_prior_are_replaced_with_a_note() -> None:
    case = captured("3r", noise=0.02)
    values = case.prior.values.copy()
    values[:10] = 0
    values[10:20] = [1, 0, 0, 0, 0, 0, 0, 0, 0, 0]
    values[26] = 1.0
    prior = replace(case.prior, values=values)
    assert not prior.is_feasible()
    fit = fit_consistent(case.base, case.estimate, prior)
    assert fit.parameters.is_feasible()
    assert [note.split(";")[0] for note in fit.notes[:3]] == [
        "body 1 of the description has no mass",
        "body 2 of the description is thinner than 3 mm or infeasible",
        "body 3 of the description is thinner than 3 mm or infeasible",
    ]
    made, _ = feasible_prior(case.base, prior)
    assert made.is_feasible() and made.values[10] == 1 and made.values[0] == 0.05


def test_unidentifiable_parameters_come_from_the_prior() -> None:
    case = captured("3r", noise=0.02, seed=1)
    lost = case.base.rank // 2
    information, covariance = case.estimate.information.copy(), np.full((case.base.rank,) * 2, 0.0)
    information[:lost], information[:, :lost] = 0, 0
    covariance[lost:, lost:] = np.linalg.inv(information[lost:, lost:])
    covariance[range(lost), range(lost)] = np.inf
    value = np.where(np.arange(case.base.rank) < lost, 1e6, case.estimate.value)
    half = replace(case.estimate, value=value, information=information, covariance=covariance)
    fit = fit_consistent(case.base, half, case.prior)
    assert fit.parameters.is_feasible() and np.isfinite(fit.moves).all() and fit.moved < 1e-3
    assert np.abs(fit.base_value[:lost]).max() < 1e3
    nothing = Estimate(value, np.full_like(covariance, np.inf), 0 * information, half.noise, half.orders)
    assert_allclose(fit_consistent(case.base, nothing, case.prior).parameters.bodies(), case.prior.bodies(), atol=1e-6)


def test_absurd_estimates_still_give_a_consistent_robot() -> None:
    case = captured("3r", noise=1e-6)
    rng = np.random.default_rng(3)
    value = case.estimate.value + 0.05 * np.abs(case.estimate.value) * rng.standard_normal(case.base.rank) - 0.02
    absurd = replace(case, estimate=replace(case.estimate, value=value))
    fit = fitted(absurd)
    assert fit.parameters.is_feasible() and not fit.feasible_without_moving
    assert fit.chi2 < 1.2 * least_chi2(absurd)


@pytest.mark.parametrize("name", ["panda", "g1"])
def test_large_robots_are_fitted(name: str) -> None:
    case = captured(name, noise=0.05, rows=200)
    assert fitted(case).parameters.is_feasible()


def test_the_nearest_standard_parameters_reproduce_the_base_parameters() -> None:
    for name in ("1r", "3r", "panda"):
        case = captured(name, noise=0.05)
        got = standard_from_base(case.base, case.estimate.value, case.prior)
        error = np.abs(case.base.combination @ got.values - case.estimate.value)
        assert error.max() < 1e-12 * np.abs(case.estimate.value).max()


def test_the_nearest_is_the_prior_itself_when_it_fits_and_no_detour_otherwise() -> None:
    case = captured("3r", noise=0.05, laws=False)
    own = standard_from_base(case.base, case.base.combination @ case.prior.values, case.prior)
    assert_allclose(own.values, case.prior.values, rtol=0, atol=1e-12)
    got = standard_from_base(case.base, case.estimate.value, case.prior)
    size = np.outer(case.prior.bodies()[:, 0], [0.3, *[0.1] * 3, *[0.01] * 6]).ravel()
    step = (got.values - case.prior.values) / size
    unseen = np.linalg.svd(case.base.combination * size)[2][case.base.rank :]
    assert_allclose(unseen @ step, 0, atol=1e-9 * np.abs(step).max())


def test_labels_must_agree() -> None:
    case, other = captured("3r", noise=0.05), captured("3r", noise=0.05, laws=False)
    with pytest.raises(ValueError, match="build both from the same robot and the same laws"):
        fit_consistent(case.base, case.estimate, other.prior)
    with pytest.raises(ValueError, match="labels"):
        standard_from_base(case.base, case.estimate.value, other.prior)
