"""Rivals of a selected law, replacement of improbable laws, and the verdict, on small evidence."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from diagnosis_rows import Question, law, moved, names, pose

from signid.diagnose.data.hypotheses import Hypothesis
from signid.diagnose.findings import alternatives
from signid.diagnose.findings.alternatives import (
    Contender,
    limit_in_step,
    rank_contenders,
    replace_weak,
    residual_energies,
)
from signid.diagnose.findings.verdict import Verdict, _drifts_first, decide_verdict
from signid.diagnose.search.contributions import measure_contributions
from signid.diagnose.search.stepwise import stepwise_search
from signid.diagnose.thresholds import FORMULA_ERROR, MAX_IN_STEP_LOG_ODDS, MIN_CAUSE_SHARE

LIBRARY = (law("viscous_friction"), law("coulomb_friction"), law("spring"), law("quadratic_friction"))
VISCOUS, SPRING = law("viscous_friction", coefficient=0.3), law("spring", stiffness=1.5, rest=0.2)
DRAG = law("quadratic_friction", coefficient=0.3)
UNKNOWN = Hypothesis(joint=0, variable="position", knots=tuple(np.linspace(-1.5, 1.5, 8).tolist()))


@pytest.fixture(autouse=True)
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Noise that may not take over a law's torque."""
    monkeypatch.setattr(alternatives._Ranking, "_penalty", lambda *_: 0.0)


def ranked(one: Question, *selected: str) -> tuple[Contender, ...]:
    return rank_contenders(one.dataset, one.selection(*(one.group(name, 0) for name in selected)))


def logit(contender: Contender, key: Any) -> float:
    return float(np.log(contender.shares[key]))


def test_rivals_of_the_same_torque_share_the_probability() -> None:
    """On one joint, drag and quadratic friction are one column; drag is positive, so its prior is twice as dense."""
    one = pose((*LIBRARY, law("fluid_drag")), DRAG)
    (quadratic,) = ranked(one, "quadratic_friction")
    own, rival = ("quadratic_friction", (0,)), ("fluid_drag", (0,))
    priors = one.posterior.priors
    expected = np.log(2) + priors[rival] - priors[own]
    assert logit(quadratic, rival) - logit(quadratic, own) == pytest.approx(expected, abs=1e-6)
    assert sum(quadratic.shares.values()) == pytest.approx(1) and set(quadratic.rivals) == {rival}
    assert quadratic.probability + quadratic.rivals[rival][0] == pytest.approx(1, abs=1e-6)


def test_rivals_that_leave_the_torque_are_not_listed() -> None:
    (viscous,) = ranked(pose(LIBRARY, VISCOUS), "viscous_friction")
    assert viscous.probability > 0.99 and viscous.rivals == {}


def test_twins_are_compared_however_unlikely_they_are() -> None:
    one = pose((*LIBRARY, law("fluid_drag")), DRAG)
    group = one.group("quadratic_friction", 0)
    found = one.selection(group)
    parts = measure_contributions(found.evidence, found.selected, found.dispersion, found.prior_scale)
    odds = one.posterior.odds(found.selected, found.dispersion, without=group)[0]
    far = {key: o._replace(log=-1e4) if key != group.claim.key else o for key, o in odds.items()}
    energies = residual_energies(one.posterior, group, far, parts)
    assert energies.keys() == {("quadratic_friction", (0,)), ("fluid_drag", (0,))}
    assert energies["fluid_drag", (0,)] < 1e-6 * energies[group.claim.key]


def test_a_dependence_is_no_rival_because_of_formula_errors() -> None:
    one = pose((*LIBRARY, UNKNOWN), SPRING, noise=1.0)
    (spring,) = ranked(one, "spring")
    group = one.group("spring", 0)
    found = one.selection(group)
    parts = measure_contributions(found.evidence, found.selected, found.dispersion, found.prior_scale)
    odds = one.posterior.odds(found.selected, found.dispersion, without=group)[0]
    energy = residual_energies(one.posterior, group, odds, parts)[group.claim.key]
    beside = one.posterior.odds(found.selected, found.dispersion)[0]["position", (0,)].log
    log = odds["position", (0,)].log - max(0.0, beside) - FORMULA_ERROR**2 / 2 * energy
    own = odds[group.claim.key].log
    assert logit(spring, ("position", (0,))) - logit(spring, group.claim.key) == pytest.approx(log - own, rel=1e-9)
    assert spring.unexplained < 1e-6


def test_torque_that_a_rival_makes_beside_the_law_does_not_count_for_it() -> None:
    one = pose(LIBRARY, VISCOUS, law("spring", stiffness=6.0, rest=0.2), noise=1.0)
    (viscous,) = ranked(one, "viscous_friction")
    found = one.selection(viscous.group)
    spring = ("spring", (0,))
    odds = one.posterior.odds(found.selected, found.dispersion, without=viscous.group)[0]
    beside = one.posterior.odds(found.selected, found.dispersion)[0][spring].log
    assert beside > 10 and odds[spring].log > odds[viscous.group.claim.key].log  # alone it explains more
    expected = odds[spring].log - beside - odds[viscous.group.claim.key].log
    assert logit(viscous, spring) - logit(viscous, viscous.group.claim.key) == pytest.approx(expected, rel=1e-9)
    assert viscous.instead is not one.group("spring", 0)


def test_a_likelier_rival_replaces_the_law() -> None:
    one = pose(LIBRARY, VISCOUS)
    wrong = one.selection(one.group("coulomb_friction", 0))
    (contender,) = rank_contenders(one.dataset, wrong)
    assert contender.instead is one.group("viscous_friction", 0)
    better, (sure,) = replace_weak(one.dataset, wrong)
    assert names(better) == {"viscous_friction"} and sure.probability > 0.99


def test_a_law_without_torque_is_dropped() -> None:
    one = pose(LIBRARY, VISCOUS)
    selection = one.selection(one.group("viscous_friction", 0), one.group("spring", 0))
    better, (sure,) = replace_weak(one.dataset, selection)
    assert names(better) == {"viscous_friction"} and sure.group is better.selected[0]


def test_one_joint_alone_is_never_in_step() -> None:
    one = pose(LIBRARY, VISCOUS)
    contenders = ranked(one, "viscous_friction")
    assert limit_in_step(one.dataset, contenders) == contenders and MAX_IN_STEP_LOG_ODDS == pytest.approx(np.log(19))


def verdict(one: Question, *selected: str) -> Verdict:
    found = replace(
        one.selection(*(one.group(name, 0) for name in selected)), first=one.posterior.odds((), one.dispersion)[0]
    )
    return decide_verdict(one.dataset, found, rank_contenders(one.dataset, found))


def test_a_law_that_explains_all_is_named() -> None:
    decided = verdict(pose(LIBRARY, SPRING), "spring")
    assert decided.name == "named" and decided.secondary == ()
    assert decided.before[0] > decided.threshold[0] > decided.after[0]
    assert not decided.is_quiet([0])


def test_noise_alone_gives_nothing_missing() -> None:
    decided = verdict(pose((*LIBRARY, UNKNOWN)))
    assert decided.name == "nothing_missing" and decided.causes == () and decided.is_quiet([0])


def wave(size: float) -> np.ndarray:
    """(N, 1) torque that depends on the position as no law does [N.m]."""
    return size * np.sign(np.sin(4 * moved().q))


def test_a_dependence_that_no_law_explains_is_unknown() -> None:
    one = pose((LIBRARY[0], UNKNOWN), more=wave(2.0))
    assert stepwise_search(one.posterior, one.dispersion).selected == ()
    assert verdict(one).name == "unknown"


def test_causes_that_leave_most_are_unknown() -> None:
    assert verdict(pose((*LIBRARY, UNKNOWN), SPRING, more=wave(3.0)), "spring").name == "unknown"
    assert verdict(pose((*LIBRARY, UNKNOWN), SPRING, more=wave(0.02)), "spring").name == "named"


def test_a_small_law_beside_a_large_one_is_a_correction() -> None:
    large, small = law("spring", stiffness=9.0, rest=0.2), law("viscous_friction", coefficient=0.1)
    one = pose(LIBRARY, large, small)
    decided = verdict(one, "viscous_friction", "spring")
    assert [group.claim.key[0] for group in decided.causes] == ["spring"]
    assert [group.claim.key[0] for group in decided.secondary] == ["viscous_friction"] and 0 < MIN_CAUSE_SHARE < 1
    equal = verdict(pose(LIBRARY, SPRING, VISCOUS), "viscous_friction", "spring")
    assert len(equal.causes) == 2


@pytest.mark.parametrize(("share", "gain", "probability", "cause"), [
    (0.05, 0.5, 0.9, True), (0.01, 0.5, 0.9, False), (0.05, 0.1, 0.9, False), (0.05, 0.5, 0.4, False),
])  # fmt: skip
def test_a_correction_that_matters_on_held_out_rows_is_a_cause(
    share: float, gain: float, probability: float, cause: bool
) -> None:
    one = pose(LIBRARY, SPRING, VISCOUS)
    spring, viscous = one.group("spring", 0), one.group("viscous_friction", 0)
    before = verdict(one, "spring", "viscous_friction")
    parts = replace(before.contributions, torque_share={spring: np.array([0.5]), viscous: np.array([share])})
    split = replace(before, causes=(spring,), secondary=(viscous,), contributions=parts)
    log = float(np.log(probability / (1 - probability)))
    contender = Contender(viscous, evidence=log, shares={viscous.claim.key: 1.0}, candidates={}, unexplained=0.0)
    after = split.with_promoted([contender], {viscous: gain})
    assert (viscous in after.causes) == cause and (viscous in after.secondary) != cause


@pytest.mark.parametrize(("level", "first"), [(1.0, "friction_drift"), (-1.0, "coulomb_friction")])
def test_friction_that_drifts_to_the_stated_level_is_a_drift(level: float, first: str) -> None:
    drift, dry = law("friction_drift", change=-0.9, time_constant=3.0), law("coulomb_friction", level=level)
    one = pose((law("friction_drift", time_constant=3.0), law("coulomb_friction")), drift, dry)
    found = one.selection(one.group("coulomb_friction", 0), one.group("friction_drift", 0))
    parts = measure_contributions(found.evidence, found.selected, found.dispersion, found.prior_scale)
    assert _drifts_first(found.selected, parts)[0].claim.kind == first
