"""Probability of a law and its rivals when the model error exceeds the covariance; order of causes."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from diagnosed import Posed, fault, posed

from signid.diagnose.data.dataset import columns_of
from signid.diagnose.evidence.bayes_factors import Evidence
from signid.diagnose.evidence.prior import StatedPrior
from signid.diagnose.findings.alternatives import Contender, _follows, limit_in_step, rank_contenders
from signid.diagnose.findings.verdict import decide_verdict
from signid.diagnose.search.stepwise import is_applicable, present_laws, resolved_violations
from signid.diagnose.thresholds import COVARIANCE_SCALES

SPRING, DRAG = fault("spring", 1, stiffness=4.0, rest=0.3), fault("quadratic_friction", 1, coefficient=0.3)
OFF = COVARIANCE_SCALES[-1]


def informed(question: Posed) -> Posed:
    """The same for a model with parameters known to 10 %."""
    evidence = question.posterior.evidence
    which = columns_of([group for group in evidence.data.refitted if group.bodies])
    known = StatedPrior(which, 100.0 * np.eye(len(which)))
    return question._replace(posterior=replace(question.posterior, evidence=Evidence(evidence.data, known)))


def contenders(question: Posed, off: float) -> tuple[Contender, ...]:
    """Probabilities of a spring and quadratic friction; the model error is `off` times that of its covariance."""
    found = question.found(question.group("spring", 0), question.group("quadratic_friction", 0))
    return rank_contenders(question.dataset, replace(found, prior_scale=off))


@pytest.fixture(scope="module")
def question() -> Posed:
    return informed(posed("1r", SPRING, DRAG))


def ratios(contender: Contender) -> dict[object, float]:
    """Log of how much less likely each rival is."""
    return {key: float(np.log(contender.probability / p)) for key, (p, _) in contender.rivals.items() if p > 1e-200}


@pytest.mark.slow
def test_evidence_between_laws_of_equal_torque_counts_less_under_model_error(question: Posed) -> None:
    (sure, _), (unsure, _) = contenders(question, 1.0), contenders(question, OFF)
    near, far = ratios(unsure), ratios(sure)
    both = near.keys() & far.keys()
    assert both and all(abs(near[key]) < abs(far[key]) for key in both)
    assert unsure.log == pytest.approx(sure.log, rel=0.2)  # that it is there at all


def test_causes_that_stay_under_inflated_noise_come_first(question: Posed) -> None:
    spring, drag = contenders(question, OFF)
    assert 0 < spring.log_at_scale < spring.log
    found = question.found(spring.group, drag.group)
    for weak, strong in ((spring, drag), (drag, spring)):
        ranked = (replace(weak, log_at_scale=-1.0), replace(strong, log_at_scale=1.0))
        assert decide_verdict(question.dataset, found, ranked).causes == (strong.group, weak.group)


def test_a_model_without_covariance_demotes_nothing() -> None:
    assert all(contender.log_at_scale == np.inf for contender in contenders(posed("1r", SPRING, DRAG), 2.0))


def test_laws_of_joints_in_step_are_uncertain() -> None:
    one = posed("3r", SPRING)
    before = rank_contenders(one.dataset, one.found(one.group("spring", 0)))
    assert limit_in_step(one.dataset, before) == before and before[0].probability > 0.99
    alike = [p._replace(motion=replace(p.motion, v=p.motion.v[:, [0, 0, 2]])) for p in one.dataset.pieces]
    (after,) = limit_in_step(replace(one.dataset, pieces=tuple(alike)), before)
    assert after.probability <= 0.95 and after.log <= np.log(19) + 1e-9


def test_a_law_that_changes_another_depends_on_it() -> None:
    one = posed("1r", SPRING, DRAG)
    bare = cast(Any, SimpleNamespace(evidence=SimpleNamespace(data=SimpleNamespace(refitted=()))))
    drift, spring = one.group("friction_drift", 0), one.group("spring", 0)
    assert is_applicable(drift, present_laws(one.found()))  # of a simulation that states dry friction
    assert not is_applicable(drift, present_laws(replace(one.found(spring), posterior=bare)))
    assert is_applicable(spring, present_laws(replace(one.found(), posterior=bare)))


@pytest.mark.parametrize(("before", "name"), [(1.0, "nothing_missing"), (200.0, "unknown")])
def test_without_causes_only_large_torque_is_missing(before: float, name: str) -> None:
    one = posed("1r", SPRING, DRAG)
    found = one.found(one.group("spring", 0))
    decided = decide_verdict(one.dataset, found, rank_contenders(one.dataset, found))
    assert decided.name == "named"
    verdict = replace(decided, before=np.array([before]), threshold=np.array([100.0]))
    assert verdict.without(found.selected).name == name and verdict.without(()).name == "named"
    assert verdict.is_quiet([0]) == (name == "nothing_missing")


def test_causes_contradicted_by_held_out_rows_are_corrections_beside_others() -> None:
    one = posed("1r", SPRING, DRAG)
    spring, drag = one.group("spring", 0), one.group("quadratic_friction", 0)
    found = one.found(spring, drag)
    decided = decide_verdict(one.dataset, found, rank_contenders(one.dataset, found))
    both = replace(decided, causes=(spring, drag), secondary=())
    assert both.with_demoted({drag}).causes == (drag,) and both.with_demoted({drag}).secondary == (spring,)
    assert both.with_demoted(()).causes == (spring, drag)


def test_a_link_error_explains_inertial_violations() -> None:
    heavy = posed("3r", heavier=(("link_3", 1.5),))
    link, spring = heavy.group("link_inertia", 2), heavy.group("spring", 0)
    assert resolved_violations(heavy.found(link), heavy.found(), link) == {2}
    assert resolved_violations(heavy.found(spring), heavy.found(), spring) == set()


@pytest.mark.slow_cases("True")
@pytest.mark.parametrize(("joints", "limited"), [([0, 1, 2], True), ([0, 1], False)])
def test_laws_of_all_joints_are_uncertain_when_all_move_in_step(joints: list[int], limited: bool) -> None:
    assert _follows(posed("3r").group("base_tilt", 0, 1, 2), joints) == limited
    assert _follows(posed("3r").group("spring", 1), joints) and not _follows(posed("3r").group("spring", 2), [0, 1])
