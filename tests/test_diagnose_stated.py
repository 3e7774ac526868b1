"""Stated parameters that contradict held-out rows are named with both values; others are not."""

from __future__ import annotations

from dataclasses import replace

import pytest
from diagnosed import DRIVES, Posed, fault, posed

from signid.diagnose.extend.holdout import predict
from signid.diagnose.findings.held_out_selection import ExtendedSimulation
from signid.diagnose.findings.stated import stated_number_findings
from signid.types import Law

pytestmark = pytest.mark.xdist_group("planted")

STATED, MORE = DRIVES["1r"].coulomb_friction[0], 0.25


def handed_out(question: Posed, level: float) -> ExtendedSimulation:
    """A simulation with all stated parameters of laws refitted; dry friction gets the given level."""
    model, laws = question.dataset.model, list[Law]()
    for law in model.laws:
        dry = law.effect.name == "coulomb_friction"
        laws.append(replace(law, parameters={"level": level}) if dry else law)
    prediction = predict(question.session, replace(model, laws=tuple(laws)))
    refitted = frozenset(g for g in question.posterior.evidence.data.refitted if g.law is not None)
    return ExtendedSimulation({}, prediction, frozenset(), refitted, {}, {})


def test_a_wrong_stated_parameter_is_named_with_both_values() -> None:
    question = posed("1r", fault("coulomb_friction", 1, level=MORE))
    extended = handed_out(question, STATED + MORE)
    (found,) = stated_number_findings(question.dataset, question.session, question.found(), extended)
    assert (found.law.effect.name, found.law.joints, found.role) == ("coulomb_friction", (0,), "cause")
    assert found.stated == {"level": STATED} and found.law.parameters == {"level": pytest.approx(STATED + MORE)}
    assert 0.2 < found.probability < 1 and found.torque_share[0] > 0.007
    assert 0 < found.std["level"] < MORE / 3 and 0 < found.held_out_gain < 1


def test_correct_stated_parameters_are_not_named() -> None:
    question = posed("1r")
    extended = handed_out(question, STATED)
    assert not list(stated_number_findings(question.dataset, question.session, question.found(), extended))
