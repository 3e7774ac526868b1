"""A diagnosis as JSON, on the terminal and as a page."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from test_output_report import shown
from test_signs_page import Page

import signid
from signid.diagnose import Alternative, Detectable, Diagnosis, Finding, Unexplained
from signid.diagnose.data.locate import Location
from signid.effects.naming import parse_law
from signid.estimation.fit_quality import Course, Fit
from signid.output.report import to_json
from signid.output.report.results.diagnosis import diagnosis_document, diagnosis_page, diagnosis_tables
from signid.simulation.rollout import RollOut
from signid.types import Input

ROBOT = signid.load_robot("3r")
APART = "joint_2 from -1 to 1 at up to 2; signid excite ROBOT --separate a@joint_2,b@joint_2 finds a better one"
NEVER = "no motion can distinguish them; another sensor or a known load is needed"
FLAG = "payload <of> joint_3 is one of several & more"
BEFORE, AFTER, FLOOR = np.array([0.05, 0.8, 0.2]), np.array([0.05, 0.04, 0.3]), np.array([0.05, 0.04, 0.01])


def fit(rms: np.ndarray) -> Fit:
    return Fit(ROBOT.joints, ("N.m",) * 3, rms, rms, FLOOR, 1 - rms, FLOOR)


def course(rows: int, recordings: int = 1) -> Course:
    """Residuals of known size; the second joint stands still for a while."""
    k, ones = np.arange(rows), np.ones((rows, 3))
    sign = np.where(k % 2, 1.0, -1.0)[:, None]
    before, after = BEFORE * sign, AFTER * sign
    before[:10, 1] = after[:10, 1] = np.nan
    part = k * max(1, recordings) // rows
    q = np.sin(0.1 * k)[:, None] * ones
    return Course(ROBOT.joints, ("N.m",) * 3, (False,) * 3, part, part, 0.1 * k, q, np.cos(q), 2 * q, before, after)


def rolled(size: float) -> RollOut:
    error = np.full((4, 5, 3), size) * np.array([1, 2, 3])
    t = np.arange(1, 6) * 0.1
    return RollOut(ROBOT.joints, ("rad",) * 3, (0.5,), t, np.zeros(4, int), np.arange(4.0), error, 1e-3)


def finding(law: str, std: dict[str, float], **changes: Any) -> Finding:
    usual = Finding(
        law=parse_law(law, ROBOT),
        std=std,
        role="cause",
        probability=0.9994,
        torque_share=np.array([0.0, 0.26, 0.0]),
        where=Location(1, "velocity", "slower than 0.05 rad/s", 0.83, 0.9),
        statistic=120.0,
        threshold=4.0,
        held_out_gain=0.98,
        alternatives=(),
    )
    return replace(usual, **changes)


def rival(law: str, probability: float, motion: str) -> Alternative:
    return Alternative(parse_law(law, ROBOT), probability, motion)


RIVALS = (
    rival("viscous_friction@2", 0.02, APART),
    rival("asymmetric_friction@2", 1e-6, NEVER),
    rival("spring@1", 1e-9, APART),
)
FINDINGS = (
    finding("coulomb_friction@2:level=0.8", {"level": 0.01}, alternatives=RIVALS),
    finding(
        "payload:mass=0.3,first_moment_x=0.03,inertia_xx=0.001",
        {"mass": 0.02, "first_moment_x": 0.002, "first_moment_y": 0.002, "first_moment_z": 0.002, "inertia_xx": 0.01},
        probability=0.8,
        torque_share=np.array([0.1, 0.2, 0.3]),
    ),
    finding("base_tilt:x=0.01,y=0", {"x": 0.001, "y": 0.001}, role="secondary"),
    finding(
        "joint_coupling@2:partner=3,inertia=0.1,viscous=0.2,coulomb=0.3",
        {"inertia": 0.01, "viscous": 0.01, "coulomb": 0.01},
        role="secondary",
    ),
)


def made(**changes: Any) -> Diagnosis:
    """The simulation of an arm lacks two laws, and needs two more."""
    usual = Diagnosis(
        robot=ROBOT,
        verdict="named",
        findings=FINDINGS,
        unexplained=(Unexplained(2, Location(2, "time", "3 to 4 s", 0.4, 0.1), 0.05),),
        located=tuple(Location(j, "velocity", "slower than 0.05 rad/s", 0.83, 0.9) for j in range(3)),
        tolerance=0.01,
        before=fit(BEFORE),
        after=fit(AFTER),
        train=course(200),
        held_out=course(120, 2),
        rollout_before=rolled(0.5),
        rollout_after=rolled(0.01),
        model=signid.load_model("3r"),
        prior_scale=0.0,
        signs=None,
        inputs=(Input("x.csv", "0" * 64, "recording, learned from"),),
        flags=(FLAG,),
        notes=("a <note>",),
        cutoff=8.0,
        seed=7,
    )
    return replace(usual, **changes)


def screen(result: Diagnosis) -> str:
    """The report on a terminal of 100 columns."""
    return shown(diagnosis_tables(result))


@pytest.mark.parametrize(
    ("verdict", "causes", "words"),
    [
        ("named", 4, "lacks Coulomb friction of joint_2: 0.80 ± 0.02 N.m; a payload of 0.30 ± 0.04 kg\n"),
        ("named", 1, "lacks Coulomb friction of joint_2: 0.80 ± 0.02 N.m (probability >0.999)\n"),
        ("unknown", 1, "leaves more torque unexplained than it explains"),
        ("unknown", 2, "leave more torque unexplained than they explain"),
        ("unknown", 0, "lacks physics that no law explains\n"),
        ("nothing_missing", 0, "nothing is missing, within 1 % of the torque\n"),
    ],
)
def test_the_verdict_is_a_sentence(verdict: str, causes: int, words: str) -> None:
    result = made(verdict=verdict, findings=FINDINGS[:causes], after=fit(AFTER if causes else BEFORE))
    assert words in shown(diagnosis_tables(result), 200) and ("Missing" in screen(result)) == (verdict == "named")


def test_a_joint_that_got_worse_is_red() -> None:
    (table,) = [part for part in diagnosis_tables(made()) if "irreducible" in shown([part])]
    after = [str(getattr(cell, "style", "")) for cell in table.columns[2].cells]  # type: ignore[union-attr]
    assert after == ["", "", "red"]


FRICTION = finding("coulomb_friction@2:level=1.2", {"level": 0.005}, stated={"level": 0.3})
SENTENCE = "Coulomb friction of joint_2: 0.300 N.m in the simulation, 1.20 ± 0.01 N.m recorded"


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


def test_what_would_have_been_seen_is_said_listed_and_folded() -> None:
    sizes = (
        Detectable("coulomb_friction", "joint_1", "level", 0.031, "N.m"),
        Detectable("coulomb_friction", "joint_2", "level", 0.16, "N.m"),
        Detectable("payload", "joint_3", "mass", 0.0124, "kg"),
        Detectable("link_inertia", "joint_1", "mass", None, "kg"),
        Detectable("base_tilt", None, "x", 0.002, "rad"),
    )
    result = made(detectable=sizes)
    said = (
        "a probability of .9: coulomb friction of any joint above 0.160 N.m, payload above 0.0124 kg; at no plausible"
    )
    assert said in shown(diagnosis_tables(result), 300) and said not in screen(made())
    unseen = {"effect": "link_inertia", "joint": "joint_1", "parameter": "mass", "smallest": None, "unit": "kg"}
    assert document(result)["detectable"][3] == unseen
    page = diagnosis_page(result)
    assert "Smallest size of each law" in page and "link inertia, mass: joint_1 not" in page
    assert "coulomb friction, level: joint_1 0.0310 N.m, joint_2 0.160 N.m" in page
    assert "Smallest size" not in diagnosis_page(made())
