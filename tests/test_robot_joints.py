"""Mimic joints, held joints, and parameters of their drives."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, strategies as st
from toys import CHAIN, LIMIT, PAIR, joint, link, toy, urdf

from signid.errors import InputError, RobotError
from signid.robot import configuration, held_positions, hold, load_robot, robot_from_text


def test_floating_and_planar_joints_are_held_at_neutral() -> None:
    robot = toy(link("a"), link("b"), link("c"), link("d"), joint("f", "a", "b", "floating"),
                joint("p", "b", "c", "planar"), joint("z", "c", "d"))  # fmt: skip
    assert robot.joints == ("z",) and robot.drive.shape == (10, 1)
    assert "held fixed at neutral: f (floating), p (planar)" in robot.notes
    assert configuration(robot, np.array([0.5])).tolist() == [0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0.5]


MIMICS = (
    *(link(name) for name in "abcdef"),
    joint("u", "a", "b", "continuous"),
    joint("v", "b", "c", more='<mimic joint="u" multiplier="-2" offset="0.5"/>' + LIMIT),
    joint("w", "c", "d", "continuous", more='<mimic joint="v" multiplier="3" offset="1"/>'),
    joint("x", "d", "e"),
    joint("y", "e", "f", more='<mimic joint="nobody"/>' + LIMIT),
)


def test_mimics_of_mimics() -> None:
    robot = toy(*MIMICS)
    assert robot.joints == ("u", "x", "y")
    assert robot.drive.tolist() == [[1, 0, 0], [-2, 0, 0], [-6, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert robot.rest.tolist() == [0, 0.5, 2.5, 0, 0]
    assert "y (nobody)" in robot.notes[0]
    q = configuration(robot, np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(q, [np.cos(0.1), np.sin(0.1), 0.3, np.cos(1.9), np.sin(1.9), 0.2, 0.3], atol=1e-15)


def test_a_mimic_of_a_fixed_joint_stands_at_its_offset() -> None:
    robot = toy(*CHAIN[:3], link("d"), joint("f", "a", "b", "fixed"), joint("z", "b", "c"),
                joint("y", "c", "d", more='<mimic joint="f" offset="0.5"/>' + LIMIT))  # fmt: skip
    assert robot.joints == ("z",) and robot.rest.tolist() == [0, 0.5] and robot.drive.tolist() == [[1], [0]]


@given(q=st.lists(st.floats(-10, 10), min_size=3, max_size=3))
def test_configurations_agree_with_pinocchio_integrate(q: list[float]) -> None:
    robot = toy(*MIMICS)
    expected = pin.integrate(robot.model, pin.neutral(robot.model), robot.drive @ q + robot.rest)
    np.testing.assert_allclose(configuration(robot, np.array(q)), expected, atol=1e-12)


def test_configurations_of_many_and_of_the_wrong_shape() -> None:
    robot = toy(*MIMICS)
    q = np.random.default_rng(0).normal(size=(7, 3))
    assert np.array_equal(configuration(robot, q), [configuration(robot, row) for row in q])
    assert configuration(robot, np.empty((0, 3))).shape == (0, 7)
    for wrong in (np.zeros(2), np.zeros((3, 4)), np.zeros(())):
        with pytest.raises(InputError, match="each of its 3 joints"):
            configuration(robot, wrong)


def test_held_joints_have_the_torque_of_a_joint_that_stands_still() -> None:
    robot = load_robot("ur5")
    held = hold(robot, {"elbow_joint": 0.7, "1": -0.2})
    assert held.joints == ("shoulder_lift_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
    assert held.numbers == (2, 4, 5, 6) and held.model is robot.model
    assert "shoulder_pan_joint at -0.2 rad, elbow_joint at 0.7 rad" in held.notes[-1]
    assert held_positions(held) == pytest.approx({"shoulder_pan_joint": -0.2, "elbow_joint": 0.7})
    q = np.array([0.1, 0.2, 0.3, 0.4])
    full = configuration(robot, np.array([-0.2, 0.1, 0.7, 0.2, 0.3, 0.4]))
    np.testing.assert_allclose(configuration(held, q), full)
    assert hold(hold(robot, {"1": -0.2}), {"3": 0.7}).rest.tolist() == held.rest.tolist()


def test_mimics_of_held_joints_follow() -> None:
    held = hold(toy(*MIMICS), {"u": 0.25})
    assert held.rest.tolist() == [0.25, 0.0, 1.0, 0, 0] and held.drive[:3].tolist() == [[0, 0]] * 3
    assert held_positions(held) == {"u": 0.25}
    again = robot_from_text(held.document, held.kind, held.name, lock=held_positions(held))
    assert again.joints == held.joints and np.array_equal(again.rest, held.rest)


def test_a_part_of_a_robot() -> None:
    part = load_robot("panda", joints=["7", "panda_joint6"], lock={"panda_joint2": 0.5})
    assert part.joints == ("panda_joint6", "panda_joint7") and part.numbers == (6, 7)
    positions = held_positions(part)
    assert positions["panda_joint2"] == 0.5 and positions["panda_joint1"] == 0
    assert positions["panda_joint4"] == load_robot("panda").upper[3] < 0  # zero lies outside its limits
    assert "panda_joint4 at -0.0698 rad" in part.notes[-1]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"joints": ["panda_jont1"]}, "did you mean panda_joint1"),
        ({"joints": ["0"]}, "no joint '0'"),
        ({"joints": ["9"]}, "no joint '9'"),
        ({"joints": []}, "leave at least one"),
        ({"joints": ["1"], "lock": {"panda_joint1": 0}}, "both move and be locked"),
        ({"lock": {"1": 0, "panda_joint1": 0}}, "locked twice"),
        ({"lock": {"1": math.inf}}, "finite number"),
        ({"lock": {"1": "0.5"}}, "finite number"),
        ({"lock": {"1": None}}, "finite number"),
        ({"lock": {"panda_finger_joint2": 0}}, "no joint 'panda_finger_joint2' that moves by itself"),
    ],
)
def test_bad_choices_of_joints_get_a_sentence(options: dict[str, object], sentence: str) -> None:
    with pytest.raises(RobotError, match=sentence):
        load_robot("panda", **options)


def test_the_actuators_file_wins_over_the_urdf(tmp_path: Path) -> None:
    damped = LIMIT + '<dynamics damping="0.5" friction="0.25"/>'
    path = tmp_path / "toy.urdf"
    path.write_text(urdf(*CHAIN[:3], joint("z", "a", "b", more=damped), joint("y", "b", "c", more=damped)))
    (tmp_path / "actuators.toml").write_text("[joint.y]\narmature = 2\nviscous_friction = 0.75\n[joint.1]\n"
                                             "torque_offset = -1\ntorque_constant = -0.5\n")  # fmt: skip
    stated = load_robot(path).actuators
    nan = np.nan
    np.testing.assert_array_equal(stated.viscous_friction, [0.5, 0.75])
    np.testing.assert_array_equal(stated.coulomb_friction, [0.25, 0.25])
    np.testing.assert_array_equal(stated.armature, [nan, 2])
    np.testing.assert_array_equal(stated.torque_offset, [-1, nan])
    np.testing.assert_array_equal(stated.torque_constant, [-0.5, nan])
    held = load_robot(path, lock={"z": 0}).actuators
    np.testing.assert_array_equal([held.viscous_friction[0], held.armature[0]], [0.75, 2])
    other = tmp_path / "other.toml"
    other.write_text("[joint.z]\narmature = 7\n")
    np.testing.assert_array_equal(load_robot(path, actuators=other).actuators.armature, [7, nan])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[joint.elbow]\narmature = 1", "no joint 'elbow'"),
        ("[joint.z]\ninertia = 1", "unknown key 'inertia'"),
        ("[joint.z]\narmature = -1", "cannot be negative"),
        ("[joint.z]\narmature = '1'", "expected a finite number"),
        ("[joint.z]\narmature = true", "expected a finite number"),
        ("[joint.z]\narmature = nan", "expected a finite number"),
        ("[joint.z]\ntorque_offset = inf", "expected a finite number"),
        ("[joint.z]\ntorque_constant = 0", "give its value in N.m/A"),
        ("[joint]\nz = 1", "not a table"),
        ("joint = 1", "not a table"),
        ("[joints.z]\narmature = 1", "no entry 'joints'"),
        ("[joint.z]\narmature = 1\n[joint.1]\narmature = 1", "two tables"),
        ("[joint.z", "not valid TOML"),
        (b"\xff", "not UTF-8"),
        (None, "cannot be read"),
    ],
)
def test_bad_actuators_get_a_sentence(text: str | bytes | None, sentence: str, tmp_path: Path) -> None:
    path, stated = tmp_path / "toy.urdf", tmp_path / "stated.toml"
    path.write_text(urdf(*PAIR))
    if text is not None:
        stated.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(RobotError, match=sentence) as caught:
        load_robot(path, actuators=stated)
    assert "\n" not in str(caught.value) and str(caught.value).startswith("stated.toml: ")
