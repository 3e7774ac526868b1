"""Findings in words with their main number, at most three in a headline."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from test_output_report_diagnosis import ROBOT, finding, made

import signid
from signid.diagnose import Diagnosis
from signid.diagnose.result import Unexplained
from signid.effects import EFFECTS
from signid.effects.naming import law_syntax, parse_law
from signid.output.report.results.diagnosis import diagnosis_document
from signid.output.report.results.sentences import finding_headline, named, quantity, verdict_words
from signid.types import Robot


def words(law: str, std: dict[str, float | None] | None = None, robot: Robot = ROBOT) -> str:
    return finding_headline(named(robot, parse_law(law, robot), std or {}))


@pytest.mark.parametrize(
    ("law", "std", "said"),
    [
        ("payload:mass=2.7731,first_moment_x=0.1", {"mass": 0.0093}, "a payload of 2.77 ± 0.02 kg"),
        ("coulomb_friction@2:level=1.2", {"level": 0.02}, "Coulomb friction of joint_2: 1.20 ± 0.04 N.m"),
        ("time_delay@2:delay=0.005", {"delay": 1e-4}, "time delay of joint_2: 5.0 ± 0.2 ms"),
        ("time_delay:delay=-0.005", {}, "time delay: -5.00 ms"),
        ("torque_gain@1:error=0.05", {"error": 0.01}, "torque gain error of joint_1: 5 ± 2 %"),
        ("spring@1:stiffness=3,rest=1", {"stiffness": float("inf")}, "spring of joint_1: stiffness not identifiable"),
        (
            "joint_coupling@1:partner=2,inertia=0.001,viscous=0,coulomb=0.3",
            {"inertia": 0.01, "coulomb": 0.01},
            "joint coupling of joint_1 and joint_2: coulomb 0.30 ± 0.02 N.m",
        ),
        ("torque_sign@3", {}, "a wrong sign of the torque of joint_3"),
        (
            "external_contact:force_x=3,force_y=4,force_z=0,start=1,end=2",
            {"force_x": 0.1, "force_y": 0.1},
            "an external contact from 1.00 s to 2.00 s: 5.0 ± 0.2 N",
        ),
    ],
)
def test_a_finding_is_a_few_words_with_its_number(law: str, std: dict[str, float | None], said: str) -> None:
    assert words(law, std) == said


def test_every_effect_has_words_with_a_number_and_no_gap() -> None:
    for name in EFFECTS.names:
        effect = EFFECTS[name]
        if name == "empirical":
            continue
        law = law_syntax(effect).replace("[@JOINT]", "").replace("@JOINT", "@2").replace("JOINT", "1")
        law = law.replace("@2", "@3") if effect.scope == "tip" else law
        said = words(law)
        assert not re.search(r"(?:^|\s)-(?:\s|$)|[{}_](?!\d)|None|nan|inf\b", said), said
        assert re.search(r"\d", said), said


def test_numbers_that_are_not_known_are_no_dash() -> None:
    assert quantity(float("nan"), None, "N.m") == quantity(1.0, float("nan"), "N.m") == "not identifiable"
    assert quantity(0.0, 0.0, "N.m") == "0 N.m" and quantity(1e-7, 1e-9, "m") == "1.00e-07 ± 2e-09 m"
    nothing = made(verdict="nothing_missing", findings=(), tolerance=float("nan"))
    assert verdict_words(nothing) == "nothing is missing"


def test_links_of_several_joints_are_left_out() -> None:
    said = verdict_words(many(signid.load_robot("panda"), ("link_inertia", "spring"), 4))
    assert "link" in said and not re.search("[{}]", said)


def many(robot: Robot, effects: tuple[str, ...], joints: int) -> Diagnosis:
    laws = [f"{effect}@{j + 1}" for j in range(joints) for effect in effects]
    findings = [replace(finding("spring@1", {}), law=parse_law(law, robot)) for law in laws]
    return made(robot=robot, findings=tuple(findings))


def test_at_most_three_causes_and_the_number_of_all_others() -> None:
    robot = signid.load_robot("panda")
    said = verdict_words(
        many(robot, ("spring", "coulomb_friction", "viscous_friction", "torque_offset", "backlash"), 2)
    )
    assert said.count(";") == 3 and said.endswith("; and 4 more") and "springs" not in said
    assert "Coulomb friction of panda_joint1, panda_joint2: 3.00 N.m" in said
    said = verdict_words(many(robot, ("coulomb_friction",), 5))
    assert said == "the simulation lacks Coulomb friction of 5 joints: 3.00 N.m"
    mixed = [finding(law, {}) for law in ("coulomb_friction@1:level=0.5", "coulomb_friction@2:level=1.5")]
    mixed += [finding(law, {}) for law in ("coulomb_friction@3:level=1", "payload:mass=2")]
    said = verdict_words(made(findings=tuple(mixed)))
    assert said == "the simulation lacks Coulomb friction of all joints: 0.500 to 1.50 N.m; a payload of 2.00 kg"


def test_joints_that_stay_unexplained_count() -> None:
    cause = replace(finding("coulomb_friction@2:level=1", {}), torque_share=np.array([0.0, 0.4, 0.1]))
    place = made().located[0]
    left = tuple(Unexplained(j, place._replace(joint=j), share) for j, share in enumerate((0.34, 0.5, 0.999)))
    result = made(verdict="unknown", findings=(cause,), unexplained=left)
    assert [one.joint for one in result.without_cause] == [0, 2], "the cause acts on joint_2"
    assert verdict_words(result).endswith("; and 2 joints stay unexplained, 34 to >99 % of their torque")
    one = made(verdict="unknown", findings=(cause,), unexplained=left[:2])
    assert verdict_words(one) == (
        "the simulation lacks Coulomb friction of joint_2: 1.00 N.m; and 1 joint stays unexplained, 34 % of its torque"
    )
    document = diagnosis_document(result)
    assert [x["without_cause"] for x in document["unexplained"]] == [True, False, True]
    little = replace(left[0], share=0.2)
    assert not made(findings=(cause,), unexplained=(little,)).without_cause
