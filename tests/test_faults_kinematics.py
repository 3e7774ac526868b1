"""Axes of joints and positions of held joints that the description states otherwise than the robot has them."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from motions import Trial, trial
from numpy.testing import assert_allclose

import signid
from signid.check import check
from signid.errors import RecordingError
from signid.faults import RecordingFault
from signid.faults.distortions import axis_words
from signid.output.report.results.check import DESCRIPTION_FAULTS, check_document, check_summary
from signid.robot import load_robot
from signid.types import Array, Robot

FINGER = {"panda_finger_joint1": 0.0}
POSE = {"panda_joint4": -1.9, "panda_joint5": 0.6}
LINKS = (  # mass [kg], centre of mass and offset of the joint [m], principal moments [kg.m2]
    ("12", "0.02 0 0.15", "0 0 0.1", "0.12 0.12 0.03"),
    ("8", "0.12 0.01 0", "0 0 0.3", "0.012 0.06 0.06"),
    ("5", "0.1 0 0.01", "0.25 0 0", "0.006 0.025 0.025"),
)


def arm(folder: Path, axes: tuple[str, ...], kind: str = "revolute") -> Robot:
    """Three links in a row, whose joints have these axes; kind of the last joint."""
    text = '<robot name="arm"><link name="l0"/>'
    for k, ((mass, centre, offset, moments), axis) in enumerate(zip(LINKS, axes, strict=True), 1):
        x, y, z = moments.split()
        text += f'<link name="l{k}"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>'
        text += f'<inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        text += f'<joint name="j{k}" type="{kind if k == 3 else "revolute"}"><parent link="l{k - 1}"/>'
        text += f'<child link="l{k}"/><origin xyz="{offset}"/><axis xyz="{axis}"/>'
        text += '<limit lower="-3" upper="3" effort="90" velocity="9"/></joint>'
    path = folder / f"{'_'.join(axes).replace(' ', '')}.urdf"
    path.write_text(f"{text}</robot>")
    return load_robot(path)


def noisy(x: Array) -> Array:
    return x + 0.05 * np.random.default_rng(1).standard_normal(x.shape)


def columns(whole: Trial) -> dict[str, Array]:
    named = {f"q_{joint}": whole.q[:, j] for j, joint in enumerate(whole.robot.joints)}
    torque = noisy(whole.torque)
    return {"t": whole.t} | named | {f"tau_{joint}": torque[:, j] for j, joint in enumerate(whole.robot.joints)}


def faults(robot: Robot, recorded: dict[str, Array]) -> list[RecordingFault]:
    found = check(robot, [signid.read_recording(recorded, robot)])
    return [f for f in found.faults.findings if f.severity != "note" and f.kind != "excitation"]


@cache
def posed() -> Trial:
    """A Panda that stands with two joints at a pose, which nobody records."""
    return trial(load_robot("panda", lock=POSE | FINGER), seed=2)


def test_held_joints_are_named_before_the_zero_of_another() -> None:
    (fault,) = faults(load_robot("panda"), columns(posed()))
    assert (fault.kind, fault.joints, fault.severity) == ("held joints", tuple(POSE), "refuse")
    assert_allclose([fault.measures[joint] for joint in POSE], list(POSE.values()), atol=0.03)
    assert fault.measures["explained_after"] > 0.99 > fault.measures["explained_before"]
    assert "not at -0.07 and 0.00" in fault.sentence and 'lock={"panda_joint4": -1.9' in fault.sentence
    assert faults(load_robot("panda", lock=POSE), columns(posed())) == []


def test_a_wrong_pose_that_is_stated_is_named() -> None:
    (fault,) = faults(load_robot("panda", lock=POSE | {"panda_joint4": -0.8}), columns(posed()))
    assert (fault.kind, fault.joints) == ("held joints", ("panda_joint4",))
    assert fault.measures["panda_joint4"] == pytest.approx(-1.9, abs=0.03)


def test_held_joints_at_their_place_leave_other_faults_alone() -> None:
    recorded, robot = columns(posed()), load_robot("panda", lock=POSE)
    recorded["q_panda_joint6"] = recorded["q_panda_joint6"] + np.pi / 2
    (fault,) = faults(robot, recorded)
    assert (fault.kind, fault.joints) == ("position zero", ("panda_joint6",))


def test_the_assumed_positions_of_held_joints_are_printed() -> None:
    recording = signid.read_recording(columns(posed()), load_robot("panda"))
    assert "panda_joint4 (at -0.0698), panda_joint5 (at 0), panda_finger_joint1 (at 0)" in " ".join(recording.notes)


@pytest.mark.parametrize(
    ("true", "stated", "joint", "kind"),
    [
        (("0 1 0", "0 1 0", "0 0 1"), ("0 0 1", "0 1 0", "0 0 1"), 0, "revolute"),
        (("0 1 0", "1 0 0", "0 1 0"), ("0 1 0", "0 0 1", "0 1 0"), 1, "revolute"),
        (("0 1 0", "0 0 -1", "0 1 0"), ("0 1 0", "1 0 0", "0 1 0"), 1, "continuous"),
        (("0 1 0", "0 1 0", "0 1 0"), ("0 1 0", "0 1 0", "0 0 1"), 2, "continuous"),
        (("0 1 0", "0 1 0", "1 0 0"), ("0 1 0", "0 1 0", "0 0 1"), 2, "prismatic"),
    ],
)
def test_a_wrong_axis_is_named(
    tmp_path: Path, true: tuple[str, ...], stated: tuple[str, ...], joint: int, kind: str
) -> None:
    whole = trial(arm(tmp_path, true, kind), seed=1)
    (fault,) = faults(arm(tmp_path, stated, kind), columns(whole))
    assert (fault.kind, fault.joints) == ("joint axis", (f"j{joint + 1}",))
    words = [axis_words([float(x) for x in axes[joint].split()]) for axes in (true, stated)]
    assert f"is {words[0]} in the frame of its link, {words[1]} in the description" in fault.sentence
    assert fault.measures["explained_after"] > 0.98


def test_diagnosis_asks_for_the_axis_first(tmp_path: Path) -> None:
    whole = trial(arm(tmp_path, ("0 1 0", "0 1 0", "0 0 1")), seed=1)
    wrong = arm(tmp_path, ("0 0 1", "0 1 0", "0 0 1"))
    with pytest.raises(RecordingError, match="the axis of j1 is y"):
        signid.diagnose(signid.load_model(wrong.path), [signid.read_recording(columns(whole), wrong)])


def test_what_is_tried_alone_is_excluded(tmp_path: Path) -> None:
    """Axes are tried where torque is badly explained, positions of held joints where there are some as well."""
    whole = trial(arm(tmp_path, ("0 1 0", "0 1 0", "0 0 1")), seed=1)
    sound, held = columns(whole), columns(posed())
    strange = sound | {"tau_j2": np.random.default_rng(0).permutation(sound["tau_j2"])}
    odd = held | {"tau_panda_joint2": np.random.default_rng(0).permutation(held["tau_panda_joint2"])}
    for robot, recorded, tried in (
        (whole.robot, sound, ()),
        (whole.robot, strange, ("wrong axis",)),
        (load_robot("panda", lock=POSE), odd, tuple(DESCRIPTION_FAULTS)),
    ):
        found = check(robot, [signid.read_recording(recorded, robot)])
        assert tuple(words for words in check_summary(found).clear if words in DESCRIPTION_FAULTS) == tried
        assert set(found.faults.tried) == {DESCRIPTION_FAULTS[words] for words in tried}
        document = check_document(found)
        assert document["recording_faults"]["findings"] == [] or tried
