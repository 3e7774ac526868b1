"""A URDF with new inertials and friction: loads as given, and is otherwise byte for byte what it was."""

from __future__ import annotations

import difflib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from signid.errors import RobotError
from signid.output.export import urdf_with
from signid.robot import configuration, hold, load_robot, robot_from_text
from signid.types import Robot

TOUCHED = re.compile(r"inertial|inertia|<origin|<mass|<dynamics")


def feasible(robot: Robot, seed: int) -> np.ndarray:
    """Random feasible bodies: masses at points, (nb, 10)."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in robot.links:
        points = zip(rng.uniform(0.1, 2, 5), rng.normal(0, 0.2, (5, 3)), strict=True)
        body = sum((pin.Inertia(m, c, np.zeros((3, 3))) for m, c in points), pin.Inertia.Zero())
        rows.append(body.toDynamicParameters())
    return np.array(rows)


def torque(robot: Robot, bodies: np.ndarray | None, seed: int) -> np.ndarray:
    model = robot.model.copy()
    if bodies is not None:
        for i, body in enumerate(bodies):
            model.inertias[i + 1] = pin.Inertia.FromDynamicParameters(body)
    data, rng = model.createData(), np.random.default_rng(seed)
    q, v, a = rng.normal(size=(3, 20, len(robot.joints)))
    states = zip(configuration(robot, q), v @ robot.drive.T, a @ robot.drive.T, strict=True)
    return np.array([robot.drive.T @ pin.rnea(model, data, *state) for state in states])


def changed_lines(before: str, after: str) -> list[str]:
    lines = difflib.ndiff(before.splitlines(), after.splitlines(), linejunk=None, charjunk=None)
    return [line[2:] for line in lines if line[0] in "+-"]


def without(text: str, tags: str) -> str:
    """The text without these elements, the comments that stand for them, and white space."""
    text = re.sub(r"<!-- inertial included in that of .*? -->", "", text)
    text = re.sub(rf"<({tags})\b(?:[^>]*/>|.*?</\1>)", "", text, flags=re.S)
    return re.sub(r"\s+", "", text.replace("</link>", "").replace("/>", ">"))  # <link/> may have become <link></link>


@pytest.mark.parametrize("name", ["panda", "ur5", "tiago_no_hand", "talos", "pr2", "1r", "emps", "double_pendulum"])
def test_round_trip(name: str) -> None:
    robot = load_robot(name)
    n = len(robot.joints)
    bodies, viscous, coulomb = feasible(robot, 1), np.linspace(0.1, 2, n), np.linspace(0.2, 3, n)
    text = urdf_with(robot, bodies, viscous, coulomb)
    back = robot_from_text(text, "urdf", name)
    assert back.joints == robot.joints and back.links == robot.links
    found = torque(back, None, 2)
    np.testing.assert_allclose(found, torque(robot, bodies, 2), atol=1e-9, rtol=1e-9)
    np.testing.assert_allclose(back.actuators.viscous_friction, viscous, rtol=1e-15)
    np.testing.assert_allclose(back.actuators.coulomb_friction, coulomb, rtol=1e-15)
    assert without(text, "inertial|dynamics") == without(robot.document, "inertial|dynamics")


@pytest.mark.parametrize("name", ["panda", "ur5", "tiago_no_hand", "3r"])
def test_every_other_line_is_untouched(name: str) -> None:
    robot = load_robot(name)
    text = urdf_with(robot, feasible(robot, 1))
    lines = changed_lines(robot.document, text)
    assert lines
    assert [line for line in lines if not TOUCHED.search(line)] == []
    kept = [line for line in robot.document.splitlines() if not TOUCHED.search(line)]
    assert [line for line in text.splitlines() if not TOUCHED.search(line)] == kept


ODD = """<?xml version='0.0' encoding="us-ascii"?>
<!-- größe: <inertial> in a comment stays -->
<robot name='odd'   version="1.0">
\t<material name="a>b"><color rgba="1 0 0 1"/></material>
\t<link name="base"/>
\t<link   name='arm'/>
\t<link name="hand" ><!-- one --><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>\
</inertial><visual><geometry><box size="1 1 1"/></geometry></visual></link>
\t<joint type="revolute" name="shoulder" >
\t\t<parent link="base"/> <child link="arm"/>
\t\t<axis xyz="0 1 0"/>
\t\t<dynamics  friction='0.5' other="7" />
\t\t<limit lower="-1" upper="1" effort="1" velocity="1"/>
\t</joint>
\t<joint type="fixed" name="wrist"><parent link="arm"/><child link="hand"/></joint>
\t<gazebo reference="arm"><link name="arm"><inertial>kept</inertial></link></gazebo>
\t<transmission name="t"><joint name="shoulder"><dynamics damping="9"/></joint></transmission>
</robot>
"""


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_odd_but_valid_xml(newline: str) -> None:
    source = ODD.replace("\n", newline)
    robot = robot_from_text(source, "urdf", "odd")
    bodies = feasible(robot, 3)
    text = urdf_with(robot, bodies, np.array([0.25]), np.array([np.nan]))
    assert '<dynamics  friction=\'0.5\' other="7" damping="0.25" />' in text
    assert f"<link   name='arm'>{newline}\t  <inertial>{newline}\t    <origin xyz=\"" in text
    assert "<!-- one --><!-- inertial included in that of arm --><visual>" in text
    assert '<gazebo reference="arm"><link name="arm"><inertial>kept</inertial></link></gazebo>' in text
    assert '<joint name="shoulder"><dynamics damping="9"/></joint>' in text
    assert ("\r\n" in text) == (newline == "\r\n") and text.count("\n") == text.count(newline)
    back = robot_from_text(text, "urdf", "odd")
    np.testing.assert_allclose(back.model.inertias[1].toDynamicParameters(), bodies[0], atol=1e-12)
    assert (back.actuators.viscous_friction[0], back.actuators.coulomb_friction[0]) == (0.25, 0.5)


def test_nan_leaves_bodies_and_joints_alone() -> None:
    robot = load_robot("panda")
    nothing = np.full((len(robot.links), 10), np.nan)
    assert urdf_with(robot, nothing) == robot.document
    nan = np.full(len(robot.joints), np.nan)
    assert urdf_with(robot, nothing, nan, nan) == robot.document
    one = nothing.copy()
    one[2] = feasible(robot, 0)[2]
    lines = changed_lines(robot.document, urdf_with(robot, one))
    assert 0 < len(lines) < 30


def test_a_held_robot_keeps_all_its_bodies() -> None:
    robot = hold(load_robot("ur5"), {"1": 0.3})
    bodies = feasible(robot, 4)
    back = robot_from_text(urdf_with(robot, bodies), "urdf", "ur5", lock={"shoulder_pan_joint": 0.3})
    np.testing.assert_allclose(torque(back, None, 5), torque(robot, bodies, 5), atol=1e-9)


def test_friction_of_a_mimic_joint_is_counted_once() -> None:
    source = (
        '<robot name="m"><link name="a"/><link name="b"/><link name="c"/>'
        '<joint name="lead" type="revolute"><parent link="a"/><child link="b"/><dynamics damping="1" friction="2"/>'
        "</joint>"
        '<joint name="follow" type="revolute"><parent link="b"/><child link="c"/><dynamics damping="3" friction="5"/>'
        '<mimic joint="lead" multiplier="-2"/></joint></robot>'
    )
    robot = robot_from_text(source, "urdf", "m")
    assert robot.actuators.viscous_friction == [1 + 4 * 3] and robot.actuators.coulomb_friction == [2 + 2 * 5]
    text = urdf_with(robot, np.full((2, 10), np.nan), np.array([0.5]), np.array([0.25]))
    back = robot_from_text(text, "urdf", "m")
    assert back.actuators.viscous_friction == [0.5] and back.actuators.coulomb_friction == [0.25]


def test_models_that_cannot_be_written_get_a_sentence(tmp_path: Path) -> None:
    robot = load_robot("ur5")
    bodies = feasible(robot, 0)
    with pytest.raises(RobotError, match="export to URDF needs a URDF"):
        urdf_with(replace(robot, kind="mjcf"), bodies)
    with pytest.raises(RobotError, match="shapes"):
        urdf_with(robot, bodies[:-1])
    with pytest.raises(RobotError, match="shapes"):
        urdf_with(robot, bodies, np.zeros(5))
    bodies[3, 0] = 0.0
    with pytest.raises(RobotError, match="link forearm_link cannot be written|link .* cannot be written"):
        urdf_with(robot, bodies)
