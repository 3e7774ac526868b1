"""Servo mode: equal joints of several legs, priors, bounds and stated numbers."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from servo_loops import RATE, recorded
from test_servo_export import executed
from toys import joint, link, urdf

from signid.cli import run
from signid.model import Model, load_model, with_servos
from signid.output.export import export
from signid.robot import robot_from_text
from signid.robot.joints import name_pattern, similar_joints
from signid.servo.fit import ServoFit, fit_servos
from signid.servo.given import Assumptions, Bounds, Prior
from signid.servo.identify.conclude import equal_hints
from signid.servos import Servo, ServoGrid
from signid.types import Robot

HIP = Servo(kp=20.0, kd=0.9, delay=0.012, coulomb_friction=0.15, armature=0.01)
KNEE = Servo(kp=14.0, kd=0.6, delay=0.012, coulomb_friction=0.1, armature=0.008)
NUMBERS = ("kp", "kd", "delay", "coulomb_friction", "armature", "torque_offset")
HIPS, KNEES = ("left_hip", "right_hip"), ("left_knee", "right_knee")
EQUAL = Assumptions(equal=(HIPS, KNEES))
FREE = [(name, number) for name in (*HIPS, *KNEES) for number in NUMBERS]


def inertial(mass: float, y: float) -> str:
    return (
        f'<inertial><origin xyz="0 {y} -0.12"/><mass value="{mass}"/>'
        '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.002"/></inertial>'
    )


def legs_urdf() -> str:
    """A body held in the air with two legs of two joints each."""
    parts = [link("base", "")]
    for side, y in (("left", 0.1), ("right", -0.1)):
        parts += [link(f"{side}_thigh", inertial(1.4, 0.0)), link(f"{side}_shank", inertial(0.7, 0.01))]
        parts.append(joint(f"{side}_hip", "base", f"{side}_thigh", "continuous", f"0 {y} 0", "0 1 0"))
        parts.append(joint(f"{side}_knee", f"{side}_thigh", f"{side}_shank", "continuous", "0 0 -0.25", "0 1 0"))
    return urdf(*parts)


def legs() -> Robot:
    return robot_from_text(legs_urdf(), "urdf", "file")


@pytest.fixture(scope="module")
def model() -> Model:
    return load_model(legs())


TRUE = {**dict.fromkeys(HIPS, HIP), **dict.fromkeys(KNEES, KNEE)}
START = {name: servo.with_(kp=1.3 * servo.kp, kd=1.2 * servo.kd, armature=0.02) for name, servo in TRUE.items()}


@pytest.fixture(scope="module")
def grid(model: Model) -> ServoGrid:
    return recorded(model, TRUE, 10.0, 3, size=0.35, middle=1.1)


def number(fit: ServoFit, name: tuple[str, str]) -> tuple[float, float]:
    k = fit.names.index(name)
    return float(fit.values[k]), float(fit.std[k])


@pytest.mark.slow
def test_equal_joints_of_two_legs_have_one_number_from_both(model: Model, grid: ServoGrid) -> None:
    alone = fit_servos(model, [grid], START, FREE)
    both = fit_servos(model, [grid], START, FREE, assumptions=EQUAL)
    assert len(both.names) == 5 + 5 + 4 and len(both.free) == len(FREE)  # hip, knee, offsets
    assert both.owners[both.names.index(("left_hip", "kp"))] == HIPS
    assert both.owners[both.names.index(("left_hip", "delay"))] == HIPS
    for names, servo in ((HIPS, HIP), (KNEES, KNEE)):
        for what in ("kp", "kd", "coulomb_friction", "armature"):
            value, std = number(both, (names[0], what))
            assert {getattr(both.servos[name], what) for name in names} == {value}
            assert abs(value - getattr(servo, what)) < 4 * std, what
            apart = np.array([number(alone, (name, what)) for name in names])
            assert std < apart[:, 1].min(), "both legs give more than one"


@pytest.mark.slow
def test_a_prior_and_the_recordings_are_weighed_by_their_precision(model: Model, grid: ServoGrid) -> None:
    def fitted(prior: Prior) -> ServoFit:
        priors = {(name, "armature"): prior for name in HIPS}
        return fit_servos(model, [grid], START, FREE, assumptions=Assumptions(EQUAL.equal, priors))

    plain = fit_servos(model, [grid], START, FREE, assumptions=EQUAL)
    value, std = number(plain, ("left_hip", "armature"))
    sure, sure_std = number(fitted(Prior(0.02, 1e-9)), ("left_hip", "armature"))
    assert sure == pytest.approx(0.02, abs=1e-8) and sure_std < 2e-9
    vague, vague_std = number(fitted(Prior(0.02, 1.0)), ("left_hip", "armature"))
    assert vague == pytest.approx(value, abs=0.2 * std) and vague_std == pytest.approx(std, rel=0.1)
    same, same_std = number(fitted(Prior(value + std, std)), ("left_hip", "armature"))
    assert value < same < value + std and 0.6 * std < same_std < 0.95 * std


def test_a_number_stays_within_its_bounds(model: Model, grid: ServoGrid) -> None:
    bounds = {("left_hip", "kp"): Bounds(15.0, 18.0), ("right_knee", "armature"): Bounds(0.0, 1.0)}
    fit = fit_servos(model, [grid], START, FREE, assumptions=Assumptions(bounds=bounds))
    value, std = number(fit, ("left_hip", "kp"))
    assert value == pytest.approx(18.0) and std == 0.0
    assert [name for name, at in zip(fit.names, fit.at_bound, strict=True) if at] == [("left_hip", "kp")]
    inside, error = number(fit, ("right_knee", "armature"))
    assert abs(inside - KNEE.armature) < 5 * error


def log(folder: Path, servos: dict[str, Servo], seconds: float = 8.0) -> tuple[Path, Path]:
    """Files of the legs and of a recording of them."""
    robot, table = folder / "legs.urdf", folder / "log.csv"
    robot.write_text(legs_urdf())
    grid = recorded(load_model(legs()), servos, seconds, 5, size=0.35, middle=1.1)
    columns = {"t": grid.origin + np.arange(len(grid)) / RATE}
    for j, name in enumerate(grid.joints):
        columns |= {f"q_{name}": grid.q[:, j], f"q_des_{name}": grid.command[:, j]}
    pl.DataFrame(columns).write_csv(table)
    return robot, table


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    robot, table = log(tmp_path_factory.mktemp("legs"), TRUE)
    return str(robot), str(table)


def identified(files: tuple[str, str], *arguments: str, capfd: pytest.CaptureFixture[str]) -> dict[str, Any]:
    """Content of identification.json."""
    capfd.readouterr()
    assert run(["identify", *files, "--json", *arguments]) in (0, 3)
    found: dict[str, Any] = json.loads(capfd.readouterr().out)
    return found


def test_identify_writes_equal_joints_priors_bounds_and_stated_numbers(
    files: tuple[str, str], capfd: pytest.CaptureFixture[str]
) -> None:
    found = identified(
        files, "--equal", ".*_hip", "--prior", "armature@.*_knee=.05+-.005", "--bounds", "kp@left_knee=5..13",
        "--known", "coulomb_friction@.*_hip=.15", "--known", "masses", capfd=capfd,
    )  # fmt: skip
    of = {one["joint"]: one for one in found["servo"]["joints"]}
    hips = [of[name] for name in HIPS]
    assert hips[0]["equal"] == ["right_hip"] and hips[1]["equal"] == ["left_hip"] and "equal" not in of["left_knee"]
    for name in ("kp", "damping", "armature", "delay"):
        assert hips[0][name]["value"] == hips[1][name]["value"] and hips[0][name]["std"] == hips[1][name]["std"]
    assert abs(hips[0]["kp"]["value"] - HIP.kp) < 4 * hips[0]["kp"]["std"]
    assert hips[0]["coulomb_friction"]["stated"] == 0.15 and hips[0]["coulomb_friction"]["std"] is None
    assert of["right_knee"]["armature"]["prior"] == {"mean": 0.05, "std": 0.005}
    bound = of["left_knee"]["kp"]
    assert bound["value"] == pytest.approx(13.0) and bound["std"] is None and bound["at_bound"] is True
    assert bound["bounds"] == [5.0, 13.0] and "bounds" not in of["right_knee"]["kp"]
    said = " ".join(found["notes"])
    assert "left_knee: kp is at its upper bound of 13" in said
    assert "by the recordings alone, and 0.05 +- 0.0098 kg.m2 by its prior" in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--equal", "left_hip"], "matches only the servo joint left_hip; match two or more of"),
        (["--equal", "hip"], "matches no servo joint"),
        (["--equal", "(hip"], "'(hip' is no regular expression"),
        (["--known", "mass=3"], "a drive has no 'mass'; choose from kp, kd"),
        (["--known", "armature@.*_toe=.01"], "'.*_toe' is no servo joint; they are left_hip"),
        (["--known", "armature=-1"], "expected zero or a positive number"),
        (["--known", "=3"], "a drive has no ''"),
        (["--known", "kp@=3"], "write NAME=20, or NAME@PATTERN=20"),
        (["--known", "kp=20", "--known", "nothing"], "the scale of torque is known from one source"),
        (["--prior", "armature"], "armature=.01+-.005"),
        (["--prior", "armature=.01"], "as the mean"),
        (["--prior", "armature=.01+-0"], "expected a positive standard deviation after +-"),
        (["--prior", "armature=.01+-.005", "--known", "armature=.01"], "is stated, and has a prior or bounds as well"),
        (["--prior", "kp@left_hip=20+-1", "--prior", "kp@right_hip=21+-1", "--equal", ".*hip"], "different priors"),
        (["--prior", "kp=20+-1", "--bounds", "kp=1..9"], "has its mean outside the bounds"),
        (["--bounds", "kp=30..5"], "expected LOW..HIGH with LOW below HIGH"),
        (["--bounds", "kp=5"], "as the lower bound"),
        (["--bounds", "bounds.toml"], "write NAME=5..30, or NAME@PATTERN=5..30"),
        (["--law", "left_hip=duty", "--law", "right_hip=effort", "--equal", ".*hip"], "have the laws duty and effort"),
    ],
    ids=str,
)  # fmt: skip
def test_wrong_texts_are_one_sentence(
    files: tuple[str, str], arguments: list[str], words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run(["identify", *files, "--json", *arguments]) == 2
    said = capfd.readouterr().err
    assert said.count("\n") == 1 and words in said, said


def test_joints_are_alike_if_their_names_differ_in_a_side_a_finger_or_a_limb() -> None:
    dog = [f"{leg}_{part}_joint" for leg in ("FL", "FR", "RL", "RR") for part in ("hip", "thigh")]
    assert similar_joints(dog) == (tuple(dog[::2]), tuple(dog[1::2]))
    assert name_pattern(dog[::2], dog) == ".*_hip_joint" and name_pattern(dog[:3:2], dog) == "FL_hip_joint|FR_hip_joint"
    hand = ["finger_1_joint_1", "finger_1_joint_2", "finger_2_joint_1", "finger_2_joint_2"]
    assert [name_pattern(some, hand) for some in similar_joints(hand)] == ["finger_.*_joint_1", "finger_.*_joint_2"]
    assert similar_joints(["LHipPitch", "RHipPitch", "LKneePitch"]) == (("LHipPitch", "RHipPitch"),)
    assert similar_joints(["l_arm_1", "l_arm_2", "r_arm_1"]) == (("l_arm_1", "r_arm_1"),)
    assert (
        similar_joints([f"joint_{k}" for k in range(6)]) == ()
        and similar_joints(["shoulder_pan", "shoulder_lift"]) == ()
    )
    assert name_pattern(["hip-left", "hip-right"], ["hip-left", "hip-right", "hip.left"]) == "hip-.*"


def test_equal_numbers_are_hinted_at_with_the_option_to_type() -> None:
    same = {"left_hip": {"kp": (11.6, 0.4), "armature": (0.01, 0.001)}, "right_hip": {"kp": (12.0, 1.6)}}
    (said,) = equal_hints(same)
    assert said.startswith("left_hip, right_hip: no number differs") and "--equal '.*_hip'" in said
    assert list(equal_hints(same, [("left_hip", "right_hip")])) == []
    (said,) = equal_hints({**same, "right_hip": {"kp": (16.9, 0.5)}})
    assert "kp of left_hip and right_hip is 11.6 +- 0.78 and 16.9 +- 0.98 (8.3 standard deviations)" in said
    assert list(equal_hints({"left_hip": same["left_hip"], "right_hip": {"armature": (0.01, 0.001)}})) == []
    between = {"left_hip": {"kp": (11.0, 0.4)}, "right_hip": {"kp": (12.3, 0.4)}}
    assert list(equal_hints(between)) == [], "neither equal nor surely different"


@pytest.mark.slow
def test_equal_legs_are_hinted_at(files: tuple[str, str], capfd: pytest.CaptureFixture[str]) -> None:
    found = identified(files, capfd=capfd)
    said = " ".join(found["notes"])
    assert "left_hip, right_hip: no number differs beyond its interval; --equal '.*_hip' fits" in said
    both = identified(files, "--equal", ".*_hip", "--equal", ".*_knee", capfd=capfd)
    said = " ".join((*both["notes"], *both["flags"]))
    assert "left_hip, right_hip: fitted as equal drives" in said
    assert "--equal" not in said and "contradict" not in said


@pytest.mark.slow
def test_drives_that_are_not_equal_are_flagged(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    robot, table = log(tmp_path, {**TRUE, "right_hip": HIP.with_(kp=14.0, coulomb_friction=0.4)})
    flags = " ".join(identified((str(robot), str(table)), "--equal", ".*_hip", capfd=capfd)["flags"])
    assert "left_hip, right_hip: the recordings contradict equal drives: " in flags


def test_exports_have_one_entry_for_equal_joints_with_the_digits_of_their_intervals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hip = HIP.with_(kp=20.03456, kd=0.90123, armature=0.0099971234)
    marks = {"kp": 0.0094, "kd": 0.041, "armature": 3.3e-5, "coulomb_friction": 0.02}
    servos = {**dict.fromkeys(HIPS, replace(hip, std=marks)), "left_knee": KNEE, "right_knee": KNEE.with_(kp=15.0)}
    with_servos(load_model(legs()), servos).save(tmp_path / "model.json")
    model = load_model(tmp_path / "model.json")
    assert model.servos["left_hip"].std == marks and model.servos["left_hip"].kp == 20.03456
    assert model.servos["left_hip"].with_(kp=3.0).std == {key: x for key, x in marks.items() if key != "kp"}
    groups = executed(export(model, "isaaclab").text, "isaaclab.actuators", monkeypatch)["ACTUATORS"]
    assert list(groups) == [".*_hip", "left_knee", "right_knee"]
    hips = groups[".*_hip"]
    assert hips.joint_names_expr == [".*_hip"] and hips.stiffness == 20.0346 and hips.damping == 0.901
    assert hips.armature == pytest.approx(0.009997 + 0.901 * 0.005 / 2)  # inertia() of the file, at steps of 5 ms
    assert hips.friction == 0.15 and groups["right_knee"].stiffness == 15.0
    motors = executed(export(model, "mjlab").text, "mjlab.actuator", monkeypatch)["ACTUATORS"]
    assert [motor.target_names_expr for motor in motors] == [(".*_hip",), ("left_knee",), ("right_knee",)]
    assert motors[0].stiffness == 20.0346
    assert motors[0].armature == pytest.approx(0.009997 - 0.901 * 0.005 / 2)  # damping after the step, there
    assert "20.0346" in export(model, "mjcf").text and "20.03456" not in export(model, "mjcf").text
