"""Descriptions that are not plain URDF: xacro and MJCF."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from toys import PAIR, joint, refused, urdf

from signid.errors import RobotError
from signid.robot import held_positions, hold, load_robot, robot_from_text


def test_xacro(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """In a file whose name does not say so, and with errors."""
    space = ' name="toy" xmlns:xacro="http://www.ros.org/wiki/xacro"'
    half = '<xacro:property name="half" value="${pi/2}"/>'
    limit = '<limit lower="-${half}" upper="${half}" effort="1" velocity="1"/>'
    (tmp_path / "toy.urdf").write_text(urdf(half, *PAIR[:2], joint("z", "a", "b", more=limit), name=space))
    robot = load_robot(tmp_path / "toy.urdf")
    assert robot.upper == [math.pi / 2] and "half" not in robot.document and robot.kind == "urdf"
    for bad, sentence in (
        ("${nothing}", "xacro cannot expand it.*nothing"),
        ("$(find nowhere)", "xyz='package://nowhere'; expected a number"),
        ("${1/0}", "xacro cannot expand it.*division"),
    ):
        text = urdf(*PAIR[:2], joint("z", "a", "b", axis=bad), name=space)
        refused(tmp_path / "toy.xacro", text, f"^[^\\n]*{sentence}[^\\n]*$")
    assert capfd.readouterr() == ("", "")


ARM = """<mujoco model="arm"><compiler angle="degree"/><option gravity="0 0 -5"/>
<default><joint armature="0.3" damping="2" frictionloss="0.4"/>
  <default class="wrist"><joint damping="7"/></default></default>
<worldbody><geom type="plane" size="1 1 1"/>
<body name="base" pos="0 0 1" quat="0.8 0.6 0 0"><freejoint/><inertial mass="2" pos="0 0 0" diaginertia="1 1 1"/>
  <body pos="0 0 0.1"><joint name="turn" axis="0 1 0" range="-90 45"/><joint axis="1 0 0" type="slide" range="-1 0.5"/>
    <geom type="box" size=".1 .2 .3" mass="3" contype="0" conaffinity="0"/><geom type="mesh" mesh="absent"/>
    <body name="hand" pos="0 0 1" childclass="wrist"><joint name="wrist" axis="1 1 0" range="0 1" limited="false"/>
      <inertial mass="2" pos="0 0 0.1" diaginertia="1 1 1"/>
      <body name="tip"><joint name="ball" type="ball"/><geom size="0.1"/></body></body></body></body>
<body name="other" pos="1 0 0"><joint name="knob" axis="0 0 1"/><geom type="sphere" size="0.1" pos="0.2 0 0"/></body>
</worldbody><asset><mesh name="absent" file="absent.stl"/></asset>
<equality><joint joint1="knob" joint2="turn" polycoef="0.1 2 0 0 0"/><weld body1="tip" body2="other"/></equality>
</mujoco>"""


def test_mjcf() -> None:
    robot = robot_from_text(ARM, "mjcf", "file")
    assert robot.name == "arm" and robot.joints == ("turn", "joint_3", "wrist") and robot.numbers == (1, 2, 3)
    assert robot.prismatic.tolist() == [False, True, False]
    np.testing.assert_allclose(robot.lower, [-np.pi / 2, -1, -np.inf])
    np.testing.assert_allclose(robot.upper, [np.pi / 4, 0.5, np.inf])
    np.testing.assert_allclose(robot.actuators.viscous_friction, [2 + 2**2 * 2, 2, 7])
    np.testing.assert_allclose(robot.actuators.coulomb_friction, [0.4 + 2 * 0.4, 0.4, 0.4])
    np.testing.assert_allclose(robot.actuators.armature, [0.3 + 2**2 * 0.3, 0.3, 0.3])
    assert robot.model.gravity.linear.tolist() == [0, 0, -5] and not np.any(robot.model.armature)
    assert len(robot.notes) == 5
    for i, sentence in enumerate(("no name", "mass of the meshes", "body base is free", "1 equality", "neutral: ball")):
        assert sentence in robot.notes[i]
    knob = robot.model.joints[robot.model.getJointId("knob")].idx_v
    assert robot.drive[knob].tolist() == [2, 0, 0] and robot.rest[knob] == 0.1
    assert held_positions(hold(robot, {"turn": 0.25})) == {"turn": 0.25}


def test_mjcf_includes(tmp_path: Path) -> None:
    (tmp_path / "hand.xml").write_text("<mujocoinclude><body><joint/><geom size='1'/></body></mujocoinclude>")
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><worldbody><body><joint/><geom size="1"/><include file="hand.xml"/></body></worldbody></mujoco>'
    )
    robot = load_robot(path)
    assert robot.joints == ("joint_1", "joint_2") and robot.name == "arm"
    assert robot_from_text(robot.document, "mjcf", "arm").joints == robot.joints
    (tmp_path / "hand.xml").write_text('<mujocoinclude><include file="hand.xml"/></mujocoinclude>')
    with pytest.raises(RobotError, match="more than 20 files deep, or includes itself"):
        load_robot(path)


@pytest.mark.parametrize("line", ['<joint class="c"/>', '<joint/><body childclass="c"/>'])
def test_mjcf_of_an_undefined_class(line: str, tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(f'<mujoco><worldbody><body>{line}<geom size="1"/></body></worldbody></mujoco>')
    with pytest.raises(RobotError, match="MuJoCo cannot compile it: .*class"):
        load_robot(tmp_path / "arm.xml")
