"""Covariance of an identified simulation, links with scaled inertia, and wrong stated parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosed import DRIVES, Posed, fault, named, posed, read, recorded, simulation
from random_rows import BODIES, DISPERSION, rows

import signid
from signid.diagnose.data.dataset import columns_of
from signid.diagnose.data.rows import Group, build_groups
from signid.diagnose.evidence.bayes_factors import Evidence
from signid.diagnose.evidence.prior import StatedPrior, stated_prior
from signid.diagnose.extend import read_laws
from signid.diagnose.findings.held_out_selection import ExtendedSimulation
from signid.diagnose.findings.stated import stated_number_findings
from signid.diagnose.holdout import predict
from signid.diagnose.thresholds import COVARIANCE_SCALES, INTERVAL_COVARIANCE_SCALES
from signid.model import Model
from signid.regression.base_parameters import base_covariance, build_base
from signid.types import Law

LIGHTER = 0.7  # of the mass of a link, and of all its inertia
LINK = 1  # the second


@pytest.mark.parametrize(("off", "scale"), [(0.0, COVARIANCE_SCALES[0]), (2.0, COVARIANCE_SCALES[-1])])
def test_recordings_determine_the_size_of_the_model_error(off: float, scale: float) -> None:
    evidence, which = rows(7, 0.0, off), columns_of([BODIES])
    known = Evidence(evidence.data, StatedPrior(which, 30.0 * np.eye(2)))  # a standard deviation of .18
    assert known.prior_scale((), DISPERSION) == scale


def test_wrong_stated_parameters_move_further() -> None:
    evidence, which = rows(7, 0.0, 2.0), columns_of([BODIES])
    known = Evidence(evidence.data, StatedPrior(which, 30.0 * np.eye(2)))
    steps = [known.fit((), DISPERSION, scale).value[1] for scale in INTERVAL_COVARIANCE_SCALES]
    assert all(np.diff(steps) > 0) and steps[-1] == pytest.approx(2.0, rel=0.2)
    assert known.distance((), DISPERSION) > COVARIANCE_SCALES[-1]


def test_a_removed_law_is_zero_not_unknown() -> None:
    model = simulation("1r")
    base = build_base(model.robot, model.laws)
    root = np.random.default_rng(0).standard_normal((len(base.combination),) * 2)
    spread = root @ root.T + np.eye(len(root))
    whole = replace(model, covariance=base_covariance(base, np.ones(len(root)), spread))
    less = replace(whole, laws=tuple(law for law in model.laws if law.effect.name != "viscous_friction"))
    with_it, without = (_known(one) for one in (whole, less))
    assert set(without) < set(with_it)
    for one in without:
        for other in without:
            assert without[one][other] == pytest.approx(with_it[one][other], rel=1e-6)


def _known(model: Model) -> dict[str, dict[str, float]]:
    """Information on each column, by body or law."""
    motion = posed("1r").dataset.pieces[0].motion
    groups = build_groups(model, motion, [], np.zeros(1))
    found = stated_prior(model, groups)
    assert found is not None
    names = [f"{_name(group)} {k}" for group in groups for k in range(group.size) if group.start + k in found.columns]
    return {
        name: dict(zip(names, row.tolist(), strict=True)) for name, row in zip(names, found.information, strict=True)
    }


def _name(group: Group) -> str:
    return "body" if group.law is None else group.law.effect.name


@pytest.mark.slow
def test_a_link_with_scaled_inertia_is_named() -> None:
    model = simulation("3r")
    inertials = model.inertials.copy()
    inertials[LINK] *= LIGHTER
    found = signid.diagnose(replace(model, inertials=inertials), read("3r", recorded("3r")))
    assert named(found) == [("link_inertia", (LINK,))]
    (finding,) = found.findings
    lacking = dict(zip(finding.law.parameters, (model.inertials - inertials)[LINK], strict=True))
    assert all(abs(finding.law.parameters[key] - x) <= 3 * finding.std[key] + 1e-12 for key, x in lacking.items())
    assert 0 < finding.std["mass"] < 0.05 * lacking["mass"]  # with ten free parameters the mass would be unidentifiable


def test_a_factor_scales_all_parameters_of_a_link() -> None:
    question = posed("3r")
    groups = [question.posterior.evidence.data.groups[k] for k in question.posterior.keys["link_inertia", (LINK,)]]
    free, scaled = sorted(groups, key=lambda group: -group.size)
    assert (free.size, scaled.size) == (10, 1) and question.posterior.counterpart(scaled) is scaled
    inertials = simulation("3r").inertials[LINK]
    (law,) = read_laws(scaled, np.array([0.3]))
    np.testing.assert_allclose(list(law.parameters.values()), 0.3 * inertials)
    for j in question.posterior.evidence.data.rows(scaled):
        one, ten = (question.posterior.evidence.data.raw(j, group) for group in (scaled, free))
        np.testing.assert_allclose(one[:, 0], ten @ inertials, atol=1e-9)


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
    before = predict(question.session, question.dataset.model)
    (found,) = stated_number_findings(question.dataset, before, question.found(), extended)
    assert (found.law.effect.name, found.law.joints, found.role) == ("coulomb_friction", (0,), "cause")
    assert found.stated == {"level": STATED} and found.law.parameters == {"level": pytest.approx(STATED + MORE)}
    assert 0.2 < found.probability < 1 and found.torque_share[0] > 0.007
    assert 0 < found.std["level"] < MORE / 3 and 0 < found.held_out_gain < 1


def test_correct_stated_parameters_are_not_named() -> None:
    question = posed("1r")
    extended = handed_out(question, STATED)
    before = predict(question.session, question.dataset.model)
    assert not list(stated_number_findings(question.dataset, before, question.found(), extended))
