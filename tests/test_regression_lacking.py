"""Laws that a fit lacks are named with the share that they explain; a complete fit names none."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from motions import trial

import signid
from signid.identify import Identification
from signid.output.report.results.identification import identification_document, identified_numbers
from signid.regression.factors import Lack
from signid.regression.session import Options
from signid.types import Robot

USUAL = ("viscous_friction", "coulomb_friction", "torque_offset", "armature")


@pytest.fixture(scope="module")
def arm() -> Robot:
    return signid.load_robot("3r")


def identify(arm: Robot, joint: int, law: str, effects: tuple[str, ...] = USUAL) -> Identification:
    made = trial(arm)
    q, torque = made.q[:, joint], made.torque.copy()
    added = {"": 0.0, "spring": 25.0 * (q - 0.4), "counterbalance": 12.0 * np.sin(q + 0.9)}
    torque[:, joint] += added[law]
    return signid.identify(arm, [replace(made, torque=torque).noisy()], options=Options(effects=effects))


def of(found: Identification, joint: str) -> Lack:
    (lack,) = (lack for lack in found.lacks if lack.joint == joint)
    assert lack.sentence in found.flags
    return lack


@pytest.mark.parametrize(("law", "joint"), [("spring", 0), ("spring", 1), ("spring", 2), ("counterbalance", 0)])
def test_a_law_of_the_position_is_named_with_its_share(arm: Robot, law: str, joint: int) -> None:
    found = identify(arm, joint, law)
    lack = of(found, f"joint_{joint + 1}")
    assert (lack.variable, lack.effects[0]) == ("position", law)
    assert lack.share > 0.97
    assert f"position explains {100 * lack.share:.0f} % of the held-out residual of {lack.joint}" in lack.sentence


def test_friction_that_was_left_out_is_named(arm: Robot) -> None:
    found = identify(arm, 0, "", ("viscous_friction", "torque_offset", "armature"))
    assert {lack.joint for lack in found.lacks} == set(arm.joints)
    assert all(lack.effects[0] == "coulomb_friction" and lack.variable == "velocity" for lack in found.lacks)
    assert all(lack.share > 0.9 for lack in found.lacks)


def test_a_fitted_spring_has_its_stiffness_and_rest_with_intervals(arm: Robot) -> None:
    found = identify(arm, 1, "spring", ("viscous_friction", "coulomb_friction", "armature", "spring"))
    numbers = {
        x["joint"]: x["parameters"] for x in identification_document(found)["effects"] if x["effect"] == "spring"
    }
    for key, true in {"stiffness": 25.0, "rest": 0.4}.items():
        assert numbers["joint_2"][key]["value"] == pytest.approx(true, abs=3 * numbers["joint_2"][key]["std"])
        assert 0 < numbers["joint_2"][key]["std"] < 0.1 * true
    assert not [lack for lack in found.lacks if lack.joint == "joint_2"]


def test_the_rest_of_a_spring_beside_an_offset_has_no_interval(arm: Robot) -> None:
    found = identify(arm, 1, "spring", (*USUAL, "spring"))
    (spring,) = (law for law in identified_numbers(found) if law[0].law == "spring" and law[0].joint == "joint_2")
    stiffness, rest = spring
    assert stiffness.value == pytest.approx(25.0, abs=3 * (stiffness.std or np.nan)) and rest.std is None


@pytest.mark.parametrize("effects", [USUAL, (*USUAL, "quadratic_friction")])
def test_a_complete_fit_lacks_nothing(arm: Robot, effects: tuple[str, ...]) -> None:
    found = identify(arm, 0, "", effects)
    assert (found.lacks, found.flags) == ((), ())


def test_a_wrong_description_is_no_missing_law(arm: Robot) -> None:
    """Bodies that are twice as heavy as stated are found, and no spring is accused."""
    made = trial(arm)
    laws = 1.5 * made.v + 2.0 * np.sign(made.v) + 0.3 + 0.2 * made.a
    heavy = replace(made, torque=made.torque + 0.5 * (made.torque - laws))
    assert signid.identify(arm, [heavy.noisy()]).lacks == ()


def test_the_document_lists_what_is_missing(arm: Robot) -> None:
    document = json.loads(json.dumps(identification_document(identify(arm, 1, "spring"))))
    (lack,) = document["lacks"]
    assert set(lack) == {"joint", "share", "variable", "effects"}
    assert (lack["joint"], lack["effects"][0]) == ("joint_2", "spring")
