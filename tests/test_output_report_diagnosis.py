"""A diagnosis as JSON, on the terminal and as a page."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from test_output_report import shown

import signid
from signid.diagnose import Alternative, Diagnosis, Finding, Unexplained
from signid.diagnose.data.locate import Location
from signid.effects.naming import parse_law
from signid.estimation.fit_quality import Course, Fit
from signid.output.report import to_json
from signid.output.report.results.diagnosis import diagnosis_document, diagnosis_tables
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


def test_the_document_is_the_contract() -> None:
    document = json.loads(to_json(diagnosis_document(made(), [Input("3r", "1" * 64, "description")])))
    assert (document["schema"], document["verdict"], document["seed"]) == ("signid.diagnosis/1", "named", 7)
    assert [entry["path"] for entry in document["inputs"]] == ["x.csv", "3r"]
    places = [(entry["effect"], entry["joint"], entry["role"]) for entry in document["findings"]]
    assert places == [
        ("coulomb_friction", "joint_2", "cause"),
        ("payload", "joint_3", "cause"),
        ("base_tilt", None, "secondary"),
        ("joint_coupling", "joint_2", "secondary"),
    ]
    first = document["findings"][0]
    assert first["parameters"] == {"level": {"value": 0.8, "std": 0.01, "unit": "N.m"}}
    assert first["torque_share"] == {"joint_2": 0.26}
    assert {"joint": "joint_2", "variable": "velocity", "region": "slower than 0.05 rad/s"}.items() <= first[
        "where"
    ].items()
    assert first["evidence"] == {"statistic": 120.0, "threshold": 4.0, "held_out_gain": 0.98}
    assert [set(entry) for entry in first["alternatives"]] == [
        {"effect", "joint", "probability", "separating_motion"}
    ] * 3
    assert document["findings"][3]["parameters"]["partner"]["value"] == "joint_3"
    assert {"joint": "joint_3", "depends_on": "time", "share": 0.05}.items() <= document["unexplained"][0].items()
    for when, rms in (("before", BEFORE), ("after", AFTER)):
        assert document["fit"][when]["held_out_rms"] == rms.tolist()
    assert document["rollout"] == {
        "horizon": 0.5,
        "before_rms": pytest.approx([0.5, 1, 1.5]),
        "after_rms": pytest.approx([0.01, 0.02, 0.03]),
        "unit": ["rad"] * 3,
    }
    nothing = diagnosis_document(made(rollout_before=None, rollout_after=None))
    assert nothing["rollout"] is None


@pytest.mark.parametrize(
    ("verdict", "findings", "words"),
    [
        (
            "named",
            FINDINGS,
            "3r: the simulation lacks Coulomb friction of joint_2: 0.80 ± 0.02 N.m; a payload of 0.30 ± 0.04 kg\n",
        ),
        (
            "named",
            FINDINGS[:1],
            "3r: the simulation lacks Coulomb friction of joint_2: 0.80 ± 0.02 N.m (probability >0.999)\n",
        ),
        (
            "unknown",
            FINDINGS[:1],
            "3r: Coulomb friction of joint_2 (0.80 ± 0.02 N.m) leaves more torque unexplained than it explains; the "
            "simulation lacks",
        ),
        (
            "unknown",
            FINDINGS[:2],
            "N.m); a payload of 0.30 ± 0.04 kg leave more torque unexplained than they explain; the simulation lacks",
        ),
        ("unknown", (), "3r: the simulation lacks physics that no law explains\n"),
        ("nothing_missing", (), "3r: nothing is missing, within 1 % of the torque\n"),
    ],
)
def test_the_verdict_is_a_sentence(verdict: str, findings: tuple[Finding, ...], words: str) -> None:
    result = made(verdict=verdict, findings=findings, after=fit(AFTER if findings else BEFORE))
    text = screen(result)
    assert words in shown(diagnosis_tables(result), 200) and ("Missing" in text) == (verdict == "named")


def test_wrong_numbers_are_no_law_and_still_reported() -> None:
    text = screen(made(verdict="nothing_missing", findings=()))
    assert "3r: no law is missing, within 1 % of the torque, but stated parameters are wrong (at joint_2)" in text


def test_laws_of_all_joints_are_one_sentence() -> None:
    laws = [f"{name}@{j}" for j in (1, 2, 3) for name in ("viscous_friction", "coulomb_friction")]
    text = shown(diagnosis_tables(made(findings=tuple(finding(law, {}) for law in laws))), 200)
    causes = "viscous friction of all joints: 2.00 N.m.s/rad; Coulomb friction of all joints: 3.00 N.m"
    assert f"the simulation lacks {causes}\n" in text


def test_the_terminal_shows_the_main_results() -> None:
    text = screen(made())
    flat = " ".join(text.split())
    assert max(map(len, text.splitlines())) <= 100
    assert "joint_2 slower than 0.05 rad/s: 83 % of its residual torque; velocity explains 90 %" in flat
    assert "joint_1: noise only" in flat
    for words in ("level 0.800 ± 0.020 N.m", "mass 0.300 ± 0.039 kg", "26 %", "30 % of joint_3", "0.800"):
        assert words in flat, words
    assert (
        "not identifiable" not in flat
        and "inertia_xx" not in flat
        and "1 more parameter: could be zero" in flat
        and "partner" not in flat
    )
    assert "joint_coupling of joint_2 and joint_3" in flat and "base_tilt" in flat.partition("Small corrections")[2]
    assert f"or viscous_friction of joint_2, probability 0.020: {APART}" in flat
    assert f"or asymmetric_friction of joint_2, probability <0.001: {NEVER}" in flat
    assert "spring" not in flat and "and 1 more in diagnosis.json" in flat
    assert "joint_3: 5 % of its torque; 3 to 4 s: 40 % of it; no single variable explains it" in flat
    assert "Roll-outs of 0.5 s" in flat and "note: a <note>" in flat and "inertials" not in flat
    off = "The inertials of the simulation deviate by about 2.0 times the usual tolerance."
    assert off in screen(made(prior_scale=2.0))
    assert off not in screen(made(prior_scale=2.0, informed=True))


def test_a_number_without_an_interval_says_so() -> None:
    text = screen(made(findings=(finding("spring@1:stiffness=3,rest=1", {"stiffness": np.inf}),)))
    assert "stiffness not identifiable\n" in text and "rest 1.00 rad" in text


def test_a_joint_that_got_worse_is_red() -> None:
    (table,) = [part for part in diagnosis_tables(made()) if "irreducible" in shown([part])]
    after = [str(getattr(cell, "style", "")) for cell in table.columns[2].cells]  # type: ignore[union-attr]
    assert after == ["", "", "red"]
