"""diagnosis.json key by key, and the claim of the verdict "nothing_missing"."""

from __future__ import annotations

import json
from math import isfinite
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="MuJoCo is not installed; pip install 'signid[bench]'")

from diagnosed import Planted, fault, look  # noqa: E402

from signid.diagnose import Diagnosis  # noqa: E402
from signid.diagnose.thresholds import MAX_MOTIONS, MOTIONS_PER_FINDING, PLAUSIBLE_PROBABILITY  # noqa: E402
from signid.effects import EFFECTS  # noqa: E402
from signid.output.report import to_json  # noqa: E402
from signid.output.report.results.diagnosis import diagnosis_document  # noqa: E402
from signid.toml_json import check_schema  # noqa: E402

pytestmark = pytest.mark.slow_cases("contact|pendulum|payload|coupling")

NAMES = {effect.name for effect in EFFECTS}
FIT = {"joints", "unit", "train_rms", "held_out_rms", "noise_floor", "held_out_r2"}
PAYLOAD = fault("payload", mass=0.2, first_moment_x=0.03, first_moment_y=0.0, first_moment_z=0.0)
COUPLING = fault("joint_coupling", 2, partner="joint_3", inertia=0.02, viscous=0.1, coulomb=0.1)


@pytest.fixture(scope="module", params=["healthy", "payload", "coupling", "unknown", "friction", "contact", "pendulum"])
def found(request: pytest.FixtureRequest) -> Diagnosis:
    """Diagnoses of every verdict, of laws of one joint, of two, and of all."""
    contact = fault("external_contact", force_x=3.0, force_y=-2.0, force_z=4.0, start=11.0, end=13.0)
    cases = {
        "healthy": lambda: look("3r"),
        "payload": lambda: look("3r", PAYLOAD),
        "coupling": lambda: look("3r", COUPLING),
        "unknown": lambda: look("3r", fault("torque_gain", 2, error=0.1), skip=("torque_gain",)),
        "friction": lambda: look("3r", stated=("armature",)),
        "contact": lambda: look("3r", contact),
        "pendulum": lambda: look("1r", fault("encoder_offset", 1, offset=0.2)),
    }
    return cases[request.param]()


def number(x: Any) -> bool:
    return isinstance(x, float) and isfinite(x)


def written(found: Diagnosis) -> Any:
    """Document as read from the file."""
    text = to_json(diagnosis_document(found))
    return json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))


@pytest.mark.slow_cases("pendulum")
def test_the_document(found: Diagnosis) -> None:
    document, joints = written(found), list(found.robot.joints)
    check_schema(document, "diagnosis")
    for when in ("before", "after"):
        fit = document["fit"][when]
        assert set(fit) >= FIT and fit["joints"] == joints and fit["unit"] == ["N.m"] * len(joints)
        for key in FIT - {"joints", "unit"}:
            assert len(fit[key]) == len(joints) and all(map(number, fit[key])), key
        assert min(fit["noise_floor"]) > 0 and max(fit["held_out_r2"]) <= 1
    rolled = document["rollout"]
    assert rolled["horizon"] == 0.5 and rolled["unit"] == ["rad"] * len(joints)
    assert all(number(x) and x >= 0 for key in ("before_rms", "after_rms") for x in rolled[key])
    assert all(left["joint"] in joints and 0 <= left["share"] <= 1 + 1e-12 for left in document["unexplained"])
    if document["verdict"] != "named":
        assert document["verdict"] == "unknown" or document["findings"] == [] == document["unexplained"]
    else:
        assert document["findings"][0]["role"] == "cause"


def test_every_finding(found: Diagnosis) -> None:
    joints = list(found.robot.joints)
    for one in written(found)["findings"]:
        effect, evidence = EFFECTS[one["effect"]], one["evidence"]
        assert one["joint"] in joints if effect.scope in ("joint", "link", "pair", "tip") else one["joint"] is None
        assert (one["link"] in found.robot.links) if one["effect"] in ("payload", "link_inertia") else not one["link"]
        assert set(one["parameters"]) == {*effect.parameters, *(["partner"] if effect.scope == "pair" else [])}
        for key, entry in one["parameters"].items():
            assert entry["value"] in joints if key == "partner" else number(entry["value"])
            assert key == "partner" or entry["std"] is None or number(entry["std"]) and entry["std"] >= 0
        assert set(one["torque_share"]) <= set(joints) and all(x > 0 for x in one["torque_share"].values())
        assert evidence["statistic"] >= evidence["threshold"] and evidence["held_out_gain"] <= 1
        for other in one["alternatives"]:
            assert other["effect"] in NAMES and other["joint"] in (None, *joints)
            assert (other["effect"], other["joint"]) != (one["effect"], one["joint"])
        assert one["probability"] + sum(x["probability"] for x in one["alternatives"]) <= 1 + 1e-9


def test_the_likeliest_alternatives_come_first_and_have_separating_motions(found: Diagnosis) -> None:
    sought = 0
    for one in written(found)["findings"]:
        chances = [other["probability"] for other in one["alternatives"]]
        assert chances == sorted(chances, reverse=True)
        for k, other in enumerate(one["alternatives"]):
            wanted = other["probability"] > PLAUSIBLE_PROBABILITY and k < MOTIONS_PER_FINDING and sought < MAX_MOTIONS
            assert bool(other["separating_motion"]) == wanted
            sought += wanted


SILENT: list[tuple[str, Planted, tuple[str, ...]]] = [
    ("1r", fault("payload", mass=1.0, first_moment_x=0.2, first_moment_y=0.0, first_moment_z=-0.5), ()),
    ("3r", fault("link_inertia", 2, mass=0.3, first_moment_x=0.05, first_moment_y=0.0, first_moment_z=0.0), ()),
    ("3r", fault("spring", 2, stiffness=1.0, rest=0.2), ("spring",)),
]


@pytest.mark.slow_cases("link_inertia|payload")
@pytest.mark.parametrize(("robot", "planted", "skip"), SILENT, ids=[f[1][0] for f in SILENT])
def test_nothing_missing_means_a_residual_of_noise(robot: str, planted: Any, skip: tuple[str, ...]) -> None:
    """The extended simulation contains inertial errors within tolerance, or the verdict is another."""
    found = look(robot, planted, skip=skip)
    if found.verdict == "nothing_missing":
        assert np.all(found.after.train_rms < 1.6 * found.after.irreducible_rms)
    else:
        assert found.findings or found.unexplained
