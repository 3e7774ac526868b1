"""A description that states no friction: friction, rotors and offsets are one block beside every other law."""

from __future__ import annotations

import numpy as np
import pytest
from diagnosed import DRIVES, fault, look, read, recorded, simulation

import signid
from signid.diagnose import Diagnosis
from signid.diagnose.findings.stated import with_ordinary
from signid.effects import EFFECTS
from signid.output.report.results.diagnosis import diagnosis_document
from signid.output.report.results.sentences import ordinary_words, verdict_words
from signid.regression.session import Options, prepare
from signid.types import Law

SPRING = fault("spring", 2, stiffness=1.0, rest=0.2)


def beyond(found: Diagnosis) -> list[tuple[str, tuple[int, ...]]]:
    return [(x.law.effect.name, x.law.joints) for x in found.findings if not x.ordinary and x.role == "cause"]


def test_a_spring_is_first_beyond_the_ordinary() -> None:
    found = look("3r", SPRING, stated=())
    assert found.verdict == "named" and beyond(found) == [("spring", (1,))]
    first, *rest = found.findings
    assert first.law.parameters["stiffness"] == pytest.approx(1.0, abs=0.05)
    assert all(finding.ordinary for finding in rest) and verdict_words(found).startswith("the simulation lacks spring")


def test_the_ordinary_has_the_numbers_of_every_joint() -> None:
    found = look("3r", SPRING, stated=())
    document = {entry["effect"]: entry for entry in diagnosis_document(found)["ordinary"]}
    for name, unit in (("coulomb_friction", "N.m"), ("viscous_friction", "N.m.s/rad"), ("armature", "kg.m2")):
        (number,) = document[name]["parameters"].values()
        true = getattr(DRIVES["3r"], name)
        assert document[name]["joints"] == ["joint_1", "joint_2", "joint_3"] and number["unit"] == unit
        assert np.allclose(number["value"], true, atol=0.02, rtol=0.15) and all(x > 0 for x in number["std"])
    assert len(ordinary_words(found)) == len(document)


def test_a_healthy_robot_without_stated_friction_lacks_the_ordinary_alone() -> None:
    found = look("3r", stated=())
    assert found.verdict == "named" and beyond(found) == [] and not any(f.role == "secondary" for f in found.findings)
    assert np.all(found.after.held_out_rms < 1.3 * found.after.irreducible_rms)


@pytest.mark.parametrize(("levels", "count"), [((0.7, 0.7, 0.7), 12), ((0.7, 0.7, 0.2), 0), ((), 12)])
def test_equal_friction_of_all_joints_is_a_placeholder(levels: tuple[float, ...], count: int) -> None:
    model = simulation("3r", ())
    laws = tuple(Law(EFFECTS["viscous_friction"], (j,), {"coefficient": x}) for j, x in enumerate(levels))
    model = type(model)(model.robot, model.inertials, laws)
    session = prepare(model.robot, read("3r", recorded("3r"))[:2], options=Options())
    whole, free = with_ordinary(model, session, ())
    assert len(free) == count and whole.laws[: len(laws)] == laws
    assert set(with_ordinary(model, session, ("armature",))[1]) == set() if not count else True


def test_an_identified_model_is_taken_at_its_word() -> None:
    recordings = read("3r", recorded("3r"))
    model = signid.identify(simulation("3r").robot, recordings[:2]).model
    session = prepare(model.robot, recordings[:2], options=Options())
    assert with_ordinary(model, session, ()) == (model, ())
