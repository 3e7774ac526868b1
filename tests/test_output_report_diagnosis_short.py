"""A diagnosis is short on the terminal and complete in JSON; wrong numbers stand beside what the simulation states."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from test_output_report import shown
from test_output_report_diagnosis import APART, FINDINGS, ROBOT, finding, made, rival, screen
from test_signs_page import Page

from signid.diagnose import Diagnosis
from signid.effects.naming import parse_law
from signid.output.report import to_json
from signid.output.report.results.diagnosis import diagnosis_document, diagnosis_page, diagnosis_tables

FRICTION = finding("coulomb_friction@2:level=1.2", {"level": 0.005}, stated={"level": 0.3})
SENTENCE = "Coulomb friction of joint_2: 0.300 N.m in the simulation, 1.20 ± 0.01 N.m recorded"
LAWS = ("viscous_friction", "coulomb_friction", "armature", "torque_offset")


def document(result: Diagnosis) -> Any:
    return json.loads(to_json(diagnosis_document(result)))


def words(result: Diagnosis) -> str:
    """The page without tags, blanks as one."""
    return " ".join(" ".join(Page(diagnosis_page(result)).texts).split())


def test_a_wrong_number_stands_beside_the_one_of_the_simulation() -> None:
    result = made(findings=(FRICTION,))
    text = screen(result)
    assert f"3r: {SENTENCE} (probability" in " ".join(text.split())
    assert "\nWrong in the simulation\n" in text and "Missing" not in text and "lacks" not in text
    assert "\n  level: 0.3000 in the simulation, 1.2000 ± 0.0098 N.m recorded\n" in text
    level = document(result)["findings"][0]["parameters"]["level"]
    assert level == {"value": 1.2, "std": 0.005, "unit": "N.m", "stated": 0.3}
    page = words(result)
    assert (
        SENTENCE in page and "parameter in the simulation recorded ± 95 % unit level 0.3000 1.2000 0.0098 N.m" in page
    )


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"std": {"level": 0.5}}, "level: 0.300 in the simulation, 1.20 ± 0.98 N.m recorded"),
        ({"std": {}}, "level: 0.300 in the simulation, 1.20 N.m recorded"),
        ({"std": {"level": np.inf}}, "level: 0.300 N.m in the simulation, not identifiable from the recordings"),
        ({"stated": {"level": 0.0}}, "level: 0 in the simulation, 1.2000 ± 0.0098 N.m recorded"),
    ],
)
def test_both_numbers_have_the_digits_that_they_deserve(changes: dict[str, Any], line: str) -> None:
    assert f"\n  {line}\n" in screen(made(findings=(replace(FRICTION, **changes),)))


def test_several_numbers_of_a_law_are_compared_in_the_list() -> None:
    law = "asymmetric_friction@2:viscous_positive=0.1,viscous_negative=0.2,coulomb_positive=1,coulomb_negative=2"
    std = dict.fromkeys(("viscous_positive", "viscous_negative", "coulomb_positive", "coulomb_negative"), 0.01)
    result = made(findings=(finding(law, std, stated={"coulomb_positive": 0.5, "coulomb_negative": 0.5}), FRICTION))
    text = " ".join(screen(result).split())
    assert f"3r: {SENTENCE}; parameters of the simulation are wrong: asymmetric" in text
    text = shown(diagnosis_tables(replace(result, findings=result.findings[:1])), 200)
    numbers = "1.00 ± 0.02 N.m forwards, 2.00 ± 0.02 N.m backwards"
    wrong = f"parameters of the simulation are wrong: asymmetric friction of joint_2: {numbers}"
    assert f"3r: {wrong} (probability >0.999)\n" in text
    text = screen(replace(result, findings=result.findings[:1]))
    assert "\n  coulomb_positive: 0.500 in the simulation, 1.000 ± 0.020 N.m recorded\n" in text
    assert "\n  viscous_negative 0.200 ± 0.020 N.m.s/rad\n" in text and max(map(len, text.splitlines())) <= 100


def test_missing_laws_come_before_wrong_numbers() -> None:
    spring = finding("spring@1:stiffness=3,rest=1", {})
    text = shown(diagnosis_tables(made(findings=(FRICTION, spring))), 200)
    assert (
        f"3r: the simulation lacks spring of joint_1: stiffness 3.00 N.m/rad; {SENTENCE}\n" in text
        and "\nMissing or wrong\n" in text
    )
    wrong = [replace(FRICTION, law=parse_law(f"{law}@{j}", ROBOT)) for j in (1, 2) for law in LAWS[:2]]
    wrong = [replace(one, stated=dict(one.law.parameters)) for one in wrong]
    text = shown(diagnosis_tables(made(findings=(*wrong, spring))), 300)
    assert (
        "lacks spring of joint_1: stiffness 3.00 N.m/rad; parameters of the simulation are wrong: viscous friction of "
        "joint_1, joint_2: 2.00 N.m.s/rad; Coulomb friction of joint_1, joint_2: 3.00 N.m\n" in text
    )


def test_causes_are_at_most_six_and_corrections_three_lines() -> None:
    laws = [f"{law}@{j}" for law in LAWS for j in (1, 2, 3)]
    many = [finding(law, {}, alternatives=(rival("spring@3", 0.2, APART),)) for law in laws]
    few = [replace(one, role="secondary") for one in many]
    result = made(findings=(*many[:10], *few[:5]))
    text = screen(result)
    causes, _, corrections = text.partition("\nMissing\n")[2].partition("\nSmall corrections\n")
    corrections = corrections.partition("\n\n")[0]
    assert causes.count("slower than") == 6 and "and 4 smaller findings in diagnosis.json\n" in causes
    assert len(corrections.splitlines()) == 4 and "and 2 smaller findings in diagnosis.json" in corrections
    assert "viscous_friction of joint_1, probability >0.999, 26 %: coefficient" in corrections
    assert text.count("or spring of joint_3") == 6 and max(map(len, text.splitlines())) <= 100
    assert len(document(result)["findings"]) == 15
    assert all(words(result).count(one) for one in ("Torque offset of joint_1", "Coulomb friction of joint_2"))
    assert "and 1 smaller finding in diagnosis.json\n" in screen(made(findings=tuple(many[:7])))
    assert "smaller" not in screen(made(findings=tuple(many[:6])))


def test_alternatives_are_at_most_three_on_the_terminal_and_all_in_the_page() -> None:
    rivals = tuple(rival(f"{law}@2", 0.1 / 10**k, APART if k < 1 else "") for k, law in enumerate(LAWS))
    result = made(findings=(finding("spring@2", {}, alternatives=(*rivals, rival("cable_torque@2", 1e-9, ""))),))
    text = screen(result)
    assert all(f"or {law} of joint_2, probability" in text for law in LAWS[:3])
    assert "torque_offset" not in text and "cable_torque" not in text and "  and 2 more in diagnosis.json\n" in text
    assert len(document(result)["findings"][0]["alternatives"]) == 5
    page = diagnosis_page(result)
    folded = page.partition("<summary>2 more for Spring of joint_2</summary>")[2].partition("</details>")[0]
    assert "torque_offset of joint_2, probability <0.001" in folded.replace("&lt;", "<") and "cable_torque" in folded
    assert "in diagnosis.json" not in page and "more for" not in diagnosis_page(made(findings=FINDINGS[1:]))


def test_a_law_of_a_body_names_its_link() -> None:
    inertia = finding("link_inertia@2:mass=0.3,first_moment_x=0.1", {}, alternatives=(rival("payload", 0.1, ""),))
    result = made(findings=(inertia, FRICTION))
    text = " ".join(screen(result).split())
    assert (
        "the simulation lacks link inertia of joint_2 (link link_2): mass 0.300 kg; Coulomb friction of joint_2: 0.3"
        in text
    )
    assert "or payload of joint_3 (link link_3), probability 0.1" in text
    assert "Link inertia of joint_2 (link link_2): mass 0.300 kg" in words(result)
    assert [entry["link"] for entry in document(result)["findings"]] == ["link_2", None]


def test_a_finding_outside_the_extended_simulation_says_so() -> None:
    result = made(findings=(FRICTION, replace(FINDINGS[1], in_model=False)))
    assert [entry["in_model"] for entry in document(result)["findings"]] == [True, False]
    assert words(result).count("Not in the extended simulation.") == 1
    assert "  not in the extended simulation\n" in screen(result)


def test_a_simulation_with_covariance_has_a_note_of_it() -> None:
    note = "The covariance of the simulation is used as prior for its inertials and laws"
    result = made(informed=True, prior_scale=1.0)
    assert f"note: {note}" in screen(result)
    assert note in words(result) and "deviate by about" not in words(result)
    assert note in document(result)["notes"] and document(result)["inertials"] == {"off": None, "covariance": True}
    assert note not in screen(made()) and document(made(prior_scale=1.0))["inertials"] == {
        "off": 1.0,
        "covariance": False,
    }


def test_a_simulation_that_is_further_off_than_its_covariance_says_so() -> None:
    further = "their errors appear about 2.5 times larger"
    result = made(informed=True, prior_scale=2.5)
    assert further in " ".join(screen(result).split()) and further in words(result)
    assert further not in words(made(informed=True, prior_scale=1.0)) and further not in words(made(prior_scale=2.5))
