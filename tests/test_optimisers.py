"""Every algorithm by its name, within its budget, the same for the same seed, honest about how it ended."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from signid.deadline import time_limit
from signid.errors import OptionError
from signid.optimisers import OPTIMISERS, Optimum, Problem
from signid.types import Array

CENTRE = np.array([0.3, -0.2, 0.9])
ALGORITHMS = [(library, name) for library in OPTIMISERS.names for name in OPTIMISERS[library].algorithms]
SURE = [  # to find the bottom of a bowl in a few thousand evaluations
    ("nlopt", name)
    for name in "GN_CRS2_LM GN_DIRECT_L GN_MLSL_LDS LN_SBPLX LN_BOBYQA LN_COBYLA LD_SLSQP LD_LBFGS LD_MMA".split()
]


def cost(x: Array) -> float:
    return float(np.sum(np.array([1.0, 4.0, 9.0]) * (x - CENTRE) ** 2))


def slope(x: Array) -> Array:
    return 2 * np.array([1.0, 4.0, 9.0]) * (x - CENTRE)


def bowl(upper: float = 1.0) -> Problem:
    return Problem(cost, np.full(3, -1.0), np.full(3, upper), np.full(3, -0.8), slope)


def minimised(library: str, name: str | None, problem: Problem, evaluations: int = 3000, **options: float) -> Optimum:
    return OPTIMISERS[library].minimise(problem, algorithm=name, budget_evaluations=evaluations, **options)  # type: ignore[arg-type]


def test_nlopt_is_registered() -> None:
    assert OPTIMISERS.names == ("nlopt",)
    asked = (
        "GN_CRS2_LM GN_DIRECT_L GN_ISRES GN_ESCH LN_SBPLX LN_BOBYQA LN_COBYLA LN_NELDERMEAD LD_SLSQP LD_LBFGS LD_MMA"
    )
    assert set(asked.split()) <= set(OPTIMISERS["nlopt"].algorithms)


@pytest.mark.parametrize(("library", "name"), ALGORITHMS)
def test_every_algorithm_keeps_its_budget_its_box_and_its_seed(library: str, name: str) -> None:
    problem = bowl(upper=0.5)  # the bottom lies outside
    first, again = (minimised(library, name, problem, 300, seed=3) for _ in range(2))
    assert np.array_equal(first.x, again.x) and first.value == again.value
    assert first.evaluations <= 300 and first.algorithm == name
    assert (first.x >= problem.lower).all() and (first.x <= problem.upper).all()
    assert first.value == cost(first.x) <= cost(problem.start)


def test_a_tolerance_of_the_cost_ends_the_search_early() -> None:
    exact, rough = (minimised("nlopt", "LN_SBPLX", replace(bowl(), tolerance=x)) for x in (0.0, 0.02))
    assert rough.evaluations < exact.evaluations and rough.status == "converged"
    assert rough.value - exact.value < 0.02


@pytest.mark.parametrize(("library", "name"), SURE)
def test_the_bottom_of_a_bowl_is_found(library: str, name: str) -> None:
    found = minimised(library, name, bowl())
    assert_allclose(found.x, CENTRE, atol=2e-3)
    assert found.status in ("converged", "budget")


def test_local_search_says_that_it_converged_and_a_short_one_that_it_did_not() -> None:
    for library, name in (("nlopt", "LD_LBFGS"), ("nlopt", "LN_SBPLX")):
        assert minimised(library, name, bowl(), 20000).status == "converged"
        assert minimised(library, name, bowl(), 3).status == "budget"


NASTY: dict[str, tuple[float, float]] = {"nan": (np.nan, np.nan), "inf": (np.inf, 0.0), "slope": (1.0, np.nan)}


@pytest.mark.parametrize("kind", NASTY)
@pytest.mark.parametrize(("library", "name"), ALGORITHMS)
def test_costs_that_are_not_finite_neither_crash_nor_hang(library: str, name: str, kind: str) -> None:
    value, slope = NASTY[kind]
    low, up = np.full(3, -1.0), np.ones(3)
    found = minimised(library, name, Problem(lambda x: value, low, up, low / 2, lambda x: np.full(3, slope)), 200)
    assert (found.status == "failed" or kind == "slope") and found.evaluations <= 200


def test_seconds_are_a_budget_too() -> None:
    for library in OPTIMISERS.names:
        with time_limit(1e-9):
            found = minimised(library, None, bowl(), 3000)
        assert found.status == "budget" and found.evaluations == 1


def test_seeds_differ() -> None:
    runs = [minimised("nlopt", "GN_ESCH", bowl(), 200, seed=seed).x for seed in (0, 1)]
    assert not np.array_equal(*runs)


def test_unknown_algorithms_name_close_ones() -> None:
    with pytest.raises(OptionError, match=r"no algorithm 'LD_SLQP'; choose from LD_SLSQP"):
        minimised("nlopt", "LD_SLQP", bowl())
    with pytest.raises(OptionError, match="choose from LD_LBFGS"):
        minimised("nlopt", "lbfgs", bowl())
    with pytest.raises(OptionError, match="no optimiser named 'ipopt'; choose from nlopt$"):
        OPTIMISERS["ipopt"]


def test_a_gradient_is_asked_for_where_it_is_needed() -> None:
    blind = Problem(cost, np.full(3, -1.0), np.ones(3), np.zeros(3))
    with pytest.raises(OptionError, match="'LD_MMA' needs a gradient"):
        minimised("nlopt", "LD_MMA", blind)
    assert_allclose(minimised("nlopt", "LN_BOBYQA", blind).x, CENTRE, atol=1e-4)


@pytest.mark.parametrize(("library", "name"), [("nlopt", "LN_BOBYQA"), ("nlopt", "LD_LBFGS")])
def test_faults_of_the_objective_are_not_hidden(library: str, name: str) -> None:
    calls = []

    def faulty(x: Array) -> float:
        calls.append(x)
        if len(calls) > 3:
            raise ZeroDivisionError("in the objective")
        return cost(x)

    with pytest.raises(ZeroDivisionError, match="in the objective"):
        minimised(library, name, Problem(faulty, np.full(3, -1.0), np.ones(3), np.zeros(3), slope))


def test_nan_is_never_the_answer() -> None:
    def holed(x: Array) -> float:
        return float("nan") if x[0] > 0 else cost(x)

    found = minimised("nlopt", "LN_SBPLX", Problem(holed, np.full(3, -1.0), np.ones(3), np.full(3, -0.5)))
    assert found.x[0] <= 0 and np.isfinite(found.value)
    lost = minimised("nlopt", "LN_SBPLX", Problem(lambda x: float("nan"), np.zeros(2), np.ones(2), np.zeros(2)), 50)
    assert lost.status == "failed"


def test_problems_are_checked() -> None:
    with pytest.raises(ValueError, match="three vectors of one length"):
        Problem(cost, np.zeros(2), np.ones(3), np.zeros(3))
    with pytest.raises(ValueError, match=r"start\[1\] = 2 is not between 0 and 1"):
        Problem(cost, np.zeros(3), np.ones(3), np.array([0.5, 2.0, 0.5]))
