"""Penalty-based retrieval: agrees with the convex fit on small robots, and notes disagreement."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from captured import Captured, captured
from numpy.testing import assert_allclose

from signid.errors import OptionError
from signid.estimation.feasible import fit_consistent, inertial
from signid.estimation.pbrp import Bounds, Retrieval, bounds_around, physics_of, read_bounds, retrieve
from signid.types import Parameters

LINKS = ("link_1", "link_2", "link_3")


def retrieved(case: Captured, bounds: Bounds | None = None, **options: object) -> Retrieval:
    return retrieve(case.base, case.estimate, case.prior, bounds, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(("name", "laws"), [("1r", False), ("1r", True), ("3r", False)])
def test_noise_free_base_parameters_are_found_by_every_run(name: str, laws: bool) -> None:
    case = captured(name, noise=1e-6, laws=laws)
    got = retrieved(case, runs=2)
    assert got.best.feasible and got.best.converged and got.parameters.is_feasible() and got.best.violation == 0
    value = case.base.combination @ got.parameters.values
    assert_allclose(value, case.estimate.value, rtol=0, atol=1e-6 * np.abs(case.estimate.value).max())
    assert len(got.runs) == 2 and all(run.feasible and run.converged for run in got.runs)
    assert (got.global_algorithm, got.local_algorithm, got.seed) == ("GN_CRS2_LM", "LD_LBFGS", 0)


def test_inconsistent_estimates_cost_little_more_than_necessary() -> None:
    case = captured("3r", noise=0.05, seed=3, laws=False)
    got, fit = retrieved(case, runs=1), fit_consistent(case.base, case.estimate, case.prior)
    assert not fit.feasible_without_moving
    assert got.best.feasible and got.best.converged and 1 < got.best.chi2 < 1.2 * fit.chi2


def test_inconsistent_estimates_are_noted() -> None:
    case = captured("3r", noise=0.02, seed=6, laws=False)
    box = bounds_around(case.base, case.estimate, case.prior)
    lower, upper = box.lower.copy(), box.upper.copy()
    lower[24], upper[24], upper[[26, 29]] = 1.0, 1.1, 0.1  # Ixx of link 3 above Iyy + Izz
    got = retrieved(case, Bounds(lower, upper), runs=1, budget_global=500)
    assert not got.best.feasible and not got.parameters.is_feasible() and got.best.violation > 0
    assert any("the parameters are infeasible" in note for note in got.notes)


def test_a_spent_budget_is_noted() -> None:
    got = retrieved(captured("3r", noise=0.02), runs=1, rounds=2, budget_global=50, budget_local=5)
    assert not got.best.converged and "did not converge within" in got.notes[0]
    assert got.best.evaluations <= 50 + (2 + 6) * 5


def test_seeds_decide() -> None:
    case = captured("1r", noise=0.02)
    first, again, other = (retrieved(case, runs=1, budget_global=300, seed=seed) for seed in (4, 4, 5))
    assert np.array_equal(first.parameters.values, again.parameters.values)
    assert not np.array_equal(first.parameters.values, other.parameters.values)


def test_the_total_mass_is_kept_in_its_range() -> None:
    case = captured("3r", noise=0.02, seed=6, laws=False)
    for total in ((4.0, 5.0), (18.0, 19.0)):
        got = retrieved(case, runs=1, total_mass=total)
        assert total[0] - 0.01 <= got.parameters.bodies()[:, 0].sum() <= total[1] + 0.01


def test_other_algorithms_can_be_named() -> None:
    case = captured("1r", noise=0.02)
    got = retrieved(case, runs=1, global_algorithm="GN_ESCH", local_algorithm="LN_SBPLX", budget_global=500)
    assert got.best.feasible and got.best.chi2 < 1e-3
    for option, name in [("global_algorithm", "GN_CRS"), ("local_algorithm", "LD_LBFG")]:
        with pytest.raises(OptionError, match=f"no algorithm '{name}'; choose from"):
            retrieved(case, **{option: name})


@pytest.mark.parametrize(
    ("name", "local"), [("GN_CRS2_LM", "LN_SBPLX"), ("GN_DIRECT_L", "LN_BOBYQA"), ("GN_ISRES", "LD_SLSQP")]
)
def test_the_usual_algorithms_retrieve_a_pendulum(name: str, local: str) -> None:
    case = captured("1r", noise=1e-3, laws=False)
    got = retrieved(case, runs=1, global_algorithm=name, local_algorithm=local, budget_global=2000)
    assert got.best.feasible and got.best.converged and got.best.chi2 < 1e-3


@pytest.mark.slow
def test_an_arm_is_retrieved_without_gradients() -> None:
    got = retrieved(captured("3r", noise=0.05, laws=True, seed=6), runs=1, local_algorithm="LN_SBPLX")
    assert got.best.feasible and got.best.chi2 < 10


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_six_and_seven_joints_with_friction_are_retrieved(name: str) -> None:
    case = captured(name, noise=1e-3)
    got = retrieved(case, runs=1)
    assert got.best.feasible and got.best.converged and got.best.chi2 < 1e-3
    value = case.base.combination @ got.parameters.values
    assert np.linalg.norm(value - case.estimate.value) < 1e-6 * np.linalg.norm(case.estimate.value)


def test_an_unsuitable_algorithm_is_noted() -> None:
    got = retrieved(captured("3r", noise=0.02, seed=6), runs=1, global_algorithm="GN_AGS")  # at most 10 unknowns
    assert got.best.feasible and any(note.startswith("NLopt's GN_AGS failed") for note in got.notes)


def test_fixed_parameters_stay() -> None:
    case = captured("3r", noise=0.02, seed=6, laws=False)
    box = bounds_around(case.base, case.estimate, case.prior)
    fixed = np.isin(np.arange(30) % 10, [5, 7, 8])  # products of inertia
    lower, upper = np.where(fixed, case.truth.values, box.lower), np.where(fixed, case.truth.values, box.upper)
    got = retrieved(case, Bounds(lower, upper), runs=1)
    assert got.best.feasible and np.array_equal(got.parameters.values[fixed], case.truth.values[fixed])


def test_the_penalty_is_zero_for_consistent_bodies() -> None:
    case = captured("3r", noise=0.02)
    physics = physics_of(case.base, case.estimate, case.prior)
    for possible in (case.prior, case.truth):
        assert physics.violation(possible.values)[0] == 0
    values = case.truth.values.copy()
    faults: list[tuple[int, float]] = [(10, -0.5), (19, 5.0), (16, -0.1), (len(values) - 1, -1.0)]
    for place, value in faults:
        wrong = values.copy()
        wrong[place] = value
        assert physics.violation(wrong)[0] > 0
        assert not Parameters(case.base.labels, wrong).is_feasible()


def test_the_box_holds_the_description_and_the_truth() -> None:
    for name in ("1r", "3r", "ur5"):
        case = captured(name, noise=0.02)
        box = bounds_around(case.base, case.estimate, case.prior)
        for held in (case.prior.values, case.truth.values):
            assert (box.lower <= held).all() and (held <= box.upper).all()
        masses = box.lower[inertial(case.prior)].reshape(-1, 10)[:, 0]
        assert_allclose(masses, 0.2 * case.prior.bodies()[:, 0])


def test_bounds_are_read_and_kept(tmp_path: Path) -> None:
    case = captured("3r", noise=0.02, seed=6, laws=False)
    file = tmp_path / "bounds.toml"
    file.write_text("[link.link_2]\nmass = [1.0, 1.01]\nfirst_moment = [[0.1, 0.2], [0, 0], [-0.2, 0.0]]\n")
    default = bounds_around(case.base, case.estimate, case.prior)
    box = read_bounds(file, LINKS, default)
    assert_allclose(box.lower[10:14], [1.0, 0.1, 0, -0.2])
    assert_allclose(box.upper[10:14], [1.01, 0.2, 0, 0])
    rest = [*range(10), *range(14, 30)]
    assert_allclose(box.lower[rest], default.lower[rest])
    got = retrieved(case, box, runs=1).parameters.values
    assert (got >= box.lower).all() and (got <= box.upper).all()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[link.link_2\n", "is not TOML"),
        ("[body.link_2]\n", r"has body; expected only tables \[link.NAME\]"),
        ("[link.link_22]\n", "names 'link_22', which is not a moving link; choose from link_2"),
        ("[link]\nlink_1 = 3\n", r"link.link_1 in .* is 3; expected a table"),
        ("[link.link_1]\nweight = [1, 2]\n", "weight of .* is unknown; choose from mass, first_moment, inertia"),
        ("[link.link_1]\nmass = 3\n", r"mass of .* is 3; expected a pair \[lo, hi\] of finite numbers"),
        ("[link.link_1]\nmass = [1, 2, 3]\n", "expected a pair"),
        ("[link.link_1]\nmass = [1, nan]\n", "finite numbers"),
        ("[link.link_1]\nmass = [true, 2]\n", "finite numbers"),
        ("[link.link_1]\nmass = [2, 1]\n", "with lo <= hi"),
        ("[link.link_1]\nmass = [0, 1]\n", "masses above 0"),
        ("[link.link_1]\nfirst_moment = [[0, 1], [0, 1]]\n", r"expected 3 pairs \[lo, hi\]"),
        ('[link.link_1]\ninertia = "large"\n', "expected 6 pairs"),
    ],
)
def test_bad_bounds_are_refused_in_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    file = tmp_path / "bounds.toml"
    file.write_text(text)
    with pytest.raises(OptionError, match=sentence) as fault:
        read_bounds(file, LINKS, Bounds(np.zeros(30), np.ones(30)))
    assert "\n" not in str(fault.value)


def test_bad_arguments_are_refused_in_one_sentence(tmp_path: Path) -> None:
    case = captured("1r", noise=0.02)
    with pytest.raises(OptionError, match="cannot read the bounds file"):
        read_bounds(tmp_path / "none.toml", LINKS, Bounds(np.zeros(30), np.ones(30)))
    with pytest.raises(OptionError, match="give at least 1 of each"):
        retrieved(case, runs=0)
    with pytest.raises(OptionError, match=r"total_mass is \(3, 2\)"):
        retrieved(case, total_mass=(3, 2))
    with pytest.raises(OptionError, match="have 3 parameters; give the 14"):
        retrieved(case, Bounds(np.zeros(3), np.ones(3)))
    with pytest.raises(ValueError, match="swap them"):
        Bounds(np.ones(3), np.zeros(3))
    with pytest.raises(ValueError, match="not two vectors of equal length"):
        Bounds(np.zeros(3), np.full(3, np.inf))
