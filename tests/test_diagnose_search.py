"""Stepwise selection on small evidence: forward steps, exchange, removal, thresholds, admissible laws."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from diagnosis_rows import Question, law, names, pose

from signid.diagnose.search.contributions import measure_contributions, residual_growth
from signid.diagnose.search.stepwise import (
    inertial_violations,
    inflated_dispersion,
    initial_selection,
    is_admissible,
    is_applicable,
    log_posterior,
    present_laws,
    required_log_odds,
    stepwise_search,
)
from signid.diagnose.thresholds import (
    FIRST_LOG_ODDS,
    IMITATED_LOG_ODDS,
    MIN_LAW_TORQUE_SHARE,
    NEXT_LOG_ODDS,
    SHAPE_ERROR,
    UNTRUSTED_LOG_ODDS,
)
from signid.types import Law

FRICTION = (law("viscous_friction"), law("coulomb_friction"), law("quadratic_friction"))
LIBRARY = (*FRICTION, law("torque_offset"), law("spring"), law("asymmetric_friction"))
VISCOUS, DRY = law("viscous_friction", coefficient=0.3), law("coulomb_friction", level=0.5)
SPRING = law("spring", stiffness=1.5, rest=0.2)


def question(*planted: Law, noise: float = 0.02) -> Question:
    return pose(LIBRARY, *planted, noise=noise)


def correlation(one: Question, first: str, second: str) -> float:
    data = one.posterior.evidence.data
    a, b = (data.raw(0, one.group(name, 0))[:, 0] for name in (first, second))
    return float(a @ b / np.linalg.norm(a) / np.linalg.norm(b))


@pytest.mark.parametrize("planted", [VISCOUS, DRY, law("quadratic_friction", coefficient=0.3)])
def test_of_correlated_laws_the_right_one_is_selected(planted: Law) -> None:
    one = question(planted)
    assert correlation(one, "viscous_friction", "coulomb_friction") > 0.75
    assert correlation(one, "viscous_friction", "quadratic_friction") > 0.9
    assert names(stepwise_search(one.posterior, one.dispersion)) == {planted.effect.name}


@pytest.mark.parametrize(
    ("planted", "start", "found"),
    [
        ((), (), set()),
        ((VISCOUS, SPRING), (), {"viscous_friction", "spring"}),
        ((VISCOUS,), ("coulomb_friction",), {"viscous_friction"}),  # exchanged
        ((VISCOUS,), ("viscous_friction", "spring", "torque_offset"), {"viscous_friction"}),  # dropped
    ],
)
def test_what_is_selected_from_a_start(planted: tuple[Law, ...], start: tuple[str, ...], found: set[str]) -> None:
    one = question(*planted)
    begun = {one.group(name, 0): 50.0 for name in start}
    assert names(stepwise_search(one.posterior, one.dispersion, begun)) == found


def test_a_right_start_stays() -> None:
    one = question(VISCOUS, SPRING)
    start = {one.group(name, 0): 50.0 for name in ("spring", "viscous_friction")}
    found = stepwise_search(one.posterior, one.dispersion, start)
    assert found.selected == tuple(start)
    assert found.first.keys() == one.posterior.keys.keys()  # odds beside the given simulation alone


def test_a_start_from_other_rows_is_found_by_its_name() -> None:
    one, other = question(VISCOUS), pose((law("spring"), law("viscous_friction")), VISCOUS)
    start = {other.group("viscous_friction", 0): 9.0, pose((law("armature"),)).group("armature", 0): 8.0}
    begun = initial_selection(one.posterior, one.dispersion, start)
    assert begun.selected == (one.group("viscous_friction", 0),) and list(begun.log_odds.values()) == [9.0]


def test_the_first_law_is_selected_from_its_threshold_on() -> None:
    logs = []
    for noise in np.geomspace(1.2, 1.7, 6):
        one = pose((law("viscous_friction"),), VISCOUS, noise=noise)
        odds, trusted = one.posterior.odds((), one.dispersion)
        own = odds["viscous_friction", (0,)]
        needed = required_log_odds(one.posterior, own.best, trusted, 0, FIRST_LOG_ODDS)
        assert bool(stepwise_search(one.posterior, one.dispersion).selected) == (own.log >= needed)
        logs.append(own.log - needed)
    assert min(logs) < 0 < max(logs) and min(map(abs, logs)) < 1


def test_the_next_law_is_selected_from_a_lower_threshold_on() -> None:
    logs = []
    for noise in np.geomspace(1.2, 1.7, 6):
        one = pose(
            (law("spring"), law("viscous_friction")), law("spring", stiffness=9.0, rest=0.2), VISCOUS, noise=noise
        )
        spring = one.selection(one.group("spring", 0))
        own = one.posterior.odds(spring.selected, inflated_dispersion(spring))[0]["viscous_friction", (0,)]
        both = "viscous_friction" in names(stepwise_search(one.posterior, one.dispersion))
        assert both == (own.log >= NEXT_LOG_ODDS)
        logs.append(own.log - NEXT_LOG_ODDS)
    assert min(logs) < 0 < max(logs) and min(map(abs, logs)) < 1


@pytest.mark.parametrize(
    ("trusted", "informed", "imitated", "count", "violated", "needed"),
    [
        (0.9, False, 0.99, 0, (), 3.0),
        (0.1, True, 0.99, 0, (), 3.0),  # the model carries a covariance
        (0.1, False, 0.99, 0, (), IMITATED_LOG_ODDS),
        (0.1, False, 0.99, 2, (), IMITATED_LOG_ODDS),
        (0.1, False, 0.99, 2, (1,), 3.0),  # no tolerance explains that link
        (0.1, False, 0.1, 0, (), UNTRUSTED_LOG_ODDS),
        (0.1, False, 0.1, 2, (), 3.0),
    ],
)
def test_required_log_odds(
    trusted: float, informed: bool, imitated: float, count: int, violated: tuple[int, ...], needed: float
) -> None:
    evidence = SimpleNamespace(informed=informed, imitated=lambda _: imitated)
    group = SimpleNamespace(claim=SimpleNamespace(bodies={1}))
    asked: Any = SimpleNamespace(evidence=evidence), group
    assert required_log_odds(*asked, trusted, count, 3.0, violated) == needed


def test_a_law_is_replaced_by_simpler_ones_that_it_contains() -> None:
    one = question(VISCOUS, DRY)
    start = {one.group("asymmetric_friction", 0): 90.0}
    found = stepwise_search(one.posterior, one.dispersion, start)
    assert names(found) == {"viscous_friction", "coulomb_friction"}
    assert log_posterior(found) > log_posterior(one.selection(*start))


def test_a_law_that_is_more_than_its_simpler_ones_stays() -> None:
    sides = {"viscous_positive": 0.5, "viscous_negative": 0.1, "coulomb_positive": 0.6, "coulomb_negative": 0.4}
    one = question(law("asymmetric_friction", **sides))
    assert names(stepwise_search(one.posterior, one.dispersion)) == {"asymmetric_friction"}


@pytest.mark.parametrize(("size", "large"), [(0.5, False), (2.0, True)])
def test_laws_need_a_minimum_torque(size: float, large: bool) -> None:
    scale = float(question().posterior.evidence.data.scale[0])
    one = pose(LIBRARY, law("torque_offset", offset=size * MIN_LAW_TORQUE_SHARE * scale), noise=1e-3)
    assert is_admissible(one.selection(), one.group("torque_offset", 0)) == large


def test_laws_need_the_physical_sign() -> None:
    one, wrong = question(VISCOUS), question(law("viscous_friction", coefficient=-0.3))
    assert is_admissible(one.selection(), one.group("viscous_friction", 0))
    assert not is_admissible(wrong.selection(), wrong.group("viscous_friction", 0))


def test_a_law_that_selected_ones_can_make_is_redundant() -> None:
    sides = {"viscous_positive": 0.5, "viscous_negative": 0.1, "coulomb_positive": 0.6, "coulomb_negative": 0.4}
    one = question(law("asymmetric_friction", **sides))
    viscous, asymmetric = one.group("viscous_friction", 0), one.group("asymmetric_friction", 0)
    assert is_admissible(one.selection(), viscous) and is_admissible(one.selection(viscous), asymmetric)
    assert not is_admissible(one.selection(asymmetric), viscous)


def test_errors_of_formulas_inflate_the_dispersion() -> None:
    one = question(VISCOUS)
    found = one.selection(one.group("viscous_friction", 0))
    parts = measure_contributions(found.evidence, found.selected, found.dispersion, found.prior_scale)
    growth = residual_growth(parts)[found.selected[0]]
    np.testing.assert_allclose(inflated_dispersion(found, np.inf), one.dispersion + SHAPE_ERROR**2 * growth, rtol=1e-12)
    assert inflated_dispersion(found)[0] == pytest.approx(max(1.3, 1.3 * float(parts.mean_square[0])))
    np.testing.assert_array_equal(inflated_dispersion(one.selection()), one.dispersion)


def test_a_change_needs_the_law_that_it_changes() -> None:
    one = pose((law("friction_drift", time_constant=2.0), law("coulomb_friction")), DRY)
    drift, dry = one.group("friction_drift", 0), one.group("coulomb_friction", 0)
    assert not is_applicable(drift, present_laws(one.selection()))
    assert is_applicable(drift, present_laws(one.selection(dry)))


def test_inertials_within_their_tolerance_violate_nothing() -> None:
    assert inertial_violations(question(VISCOUS).selection()) == {}
    informed = cast(Any, SimpleNamespace(evidence=SimpleNamespace(informed=True)))
    assert inertial_violations(informed) == {}
