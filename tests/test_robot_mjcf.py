"""MJCF as MuJoCo itself compiles it: inverse dynamics, passive torque and limits of files with every feature."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import signid
from signid.errors import RobotError
from signid.model import load_model
from signid.regression.motion import Motion
from signid.robot import load_robot, robot_from_text

mujoco = pytest.importorskip("mujoco")
TESTDATA = Path(mujoco.__file__).parent / "testdata"
ARM = """<mujoco model="arm"><default><joint damping=".6"/></default>
<default><default class="servo"><joint armature=".03" frictionloss=".2"/><default class="fine"><joint damping=".1"/>
</default></default></default><worldbody><body name="upper" pos="0 0 .4" childclass="servo">
<inertial pos=".1 0 .05" mass="4" diaginertia=".02 .03 .04"/><joint name="one" axis="0 1 0" range="-90 90"/>
<body name="lower" pos=".3 0 0" euler="10 20 30"><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" density="800"/>
<joint name="two" class="fine" axis="0 1 1" pos=".01 .02 .03"/></body></body></worldbody></mujoco>"""
SCENE = """<mujoco><include file="arm.xml"/><statistic center="0 0 1"/><visual><headlight diffuse=".6 .6 .6"/></visual>
<asset><texture type="skybox" builtin="gradient" width="9" height="9"/><material name="plane"/></asset>
<worldbody><light pos="0 0 1"/><geom name="floor" type="plane" size="0 0 .1" material="plane"/>
<body name="table" pos="1 0 0"><geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>"""
ODD = """<mujoco><compiler angle="radian" eulerseq="zyx" autolimits="true" inertiafromgeom="auto" settotalmass="7"/>
<option gravity="0 -3 -9"/><worldbody><frame pos="0 0 .2" euler=".1 .2 .3"><body name="base"><freejoint/>
<geom size=".1"/><body name="a" pos=".1 0 0" quat="1 .2 .3 .1"><joint name="h" axis="1 2 3" ref=".3" stiffness="4"
springref=".5" damping=".2"/><joint name="s" type="slide" axis="0 0 1" pos=".1 .1 0" ref=".05" range="-.1 .2"
stiffness="30" springref=".02"/>
<geom type="box" size=".1 .05 .02"/><geom type="cylinder" size=".02 .1" pos="0 .1 0" mass=".4"/>
<frame euler="0 0 1"><body name="b" pos="0 .2 0"><inertial pos=".01 .02 .03" mass="1"
fullinertia=".02 .03 .04 .001 .002 .003"/>
<joint name="k" axis="0 1 0" actuatorfrcrange="-5 5"/><geom type="mesh" mesh="gone" material="none"/></body></frame>
<body name="m" pos="0 0 .3"><joint name="ball" type="ball"/><geom size=".05"/></body></body></body></frame>
<replicate count="2" offset="0 .5 0"><body name="r" pos="1 0 0"><joint name="p" axis="1 0 0"/><geom size=".1"
pos="0 .1 0"/></body>
</replicate><body name="puppet" mocap="true"><geom size=".1"/></body></worldbody>
<equality><joint joint1="k" joint2="h" polycoef=".1 .5 0 0 0"/><weld body1="a" body2="b"/></equality>
<actuator><position joint="h" kp="100"/></actuator><sensor><jointpos joint="h"/></sensor></mujoco>"""


def compiled(spec: Any) -> Any:
    """As MuJoCo compiles it, free and ball joints held, constraints and meshes left out."""
    for joint in list(spec.joints):
        if joint.type in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL):
            spec.delete(joint)
    for geom in list(spec.geoms):
        geom.material = ""
        if geom.type == mujoco.mjtGeom.mjGEOM_MESH:
            spec.delete(geom)
    for some in (spec.equalities, spec.sensors, spec.actuators, spec.tendons, spec.keys):
        for element in list(some):
            spec.delete(element)
    model = spec.compile()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return model


def compare(robot: signid.Robot, theirs: Any) -> None:
    """Inverse dynamics, mass matrix and passive torque at random states."""
    model, data, state = robot.model, robot.model.createData(), mujoco.MjData(theirs)
    assert (model.nv, list(map(int, theirs.jnt_dofadr))) == (theirs.nv, list(range(theirs.nv)))
    for q, v, a in np.random.default_rng(0).normal(size=(5, 3, theirs.nv)):
        state.qpos[:], state.qvel[:], state.qacc[:] = q, v, a
        mujoco.mj_inverse(theirs, state)
        torque = pin.rnea(model, data, q, v, a) + theirs.dof_armature * a
        assert_allclose(torque, state.qfrc_inverse + state.qfrc_passive, atol=1e-12 * max(1, np.abs(torque).max()))
        assert_allclose(pin.computeGeneralizedGravity(model, data, q), _bias_at_rest(theirs, q), atol=1e-11)


def _bias_at_rest(theirs: Any, q: Any) -> Any:
    state = mujoco.MjData(theirs)
    state.qpos[:] = q
    mujoco.mj_forward(theirs, state)
    return state.qfrc_bias.copy()


def test_a_scene_with_its_own_world_reads_each_body_once(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(ARM)
    (tmp_path / "scene.xml").write_text(SCENE)
    robot = load_robot(tmp_path / "scene.xml")
    assert robot.joints == ("one", "two") and robot.links == ("upper", "lower")
    assert_allclose([body.mass for body in list(robot.model.inertias)[1:]][0], 4.0)
    compare(robot, compiled(mujoco.MjSpec.from_file(str(tmp_path / "scene.xml"))))
    assert_allclose((robot.lower[0], robot.upper[0]), (-np.pi / 2, np.pi / 2))
    drives = robot.actuators
    assert drives.viscous_friction.tolist() == [0.6, 0.1] and drives.armature.tolist() == [0.03, 0.03]
    again = robot_from_text(robot.document, "mjcf", "arm")
    assert again.joints == robot.joints and again.model == robot.model


def test_every_odd_feature_has_the_torques_of_mujoco() -> None:
    robot, theirs = robot_from_text(ODD, "mjcf", "odd"), compiled(mujoco.MjSpec.from_string(ODD))
    compare(robot, theirs)
    assert robot.joints == ("h", "s", "p0", "p1"), "k follows h"
    assert sorted(robot.springs) == ["h", "s"] and robot.effort_limit[0] == np.inf
    said = " ".join(robot.notes)
    for word in ("body base is free", "held fixed at neutral: ball", "1 equality constraints are ignored"):
        assert word in said
    assert "mesh" not in said, "b states its inertial"
    y = robot.drive @ np.array([0.3, 0, 0, 0]) + robot.rest
    assert_allclose(y[2], 0.1 + 0.5 * (0.3 - 0.3)), "y - y0 = a + b (x - x0)"


def test_springs_are_laws_of_the_simulation() -> None:
    text = ODD[: ODD.index("<equality>")] + "</mujoco>"
    model, theirs = load_model(robot_from_text(text, "mjcf", "odd")), compiled(mujoco.MjSpec.from_string(text))
    assert [law.effect.name for law in model.laws].count("spring") == 2
    q = np.random.default_rng(1).normal(size=(3, theirs.nv))
    rest = Motion(model.robot, np.arange(3.0), q, 0 * q, 0 * q)
    for row, torque in zip(q, model.inverse(rest), strict=True):
        state = mujoco.MjData(theirs)
        state.qpos[:] = row
        mujoco.mj_inverse(theirs, state)
        assert_allclose(torque, state.qfrc_inverse, atol=1e-10)


def test_gravcomp_is_noted() -> None:
    robot = robot_from_text(ARM.replace('name="lower"', 'name="lower" gravcomp="1"'), "mjcf", "arm")
    assert any("gravcomp of lower is ignored" in note for note in robot.notes)


def test_the_test_data_of_mujoco_are_read_or_refused_in_one_sentence() -> None:
    for path in sorted(TESTDATA.glob("*.xml")):
        try:
            assert load_robot(path).joints
        except RobotError as error:
            assert "\n" not in str(error)


def test_bombs_by_number_are_refused(tmp_path: Path) -> None:
    many = '<include file="{}"/>' * 10
    for k in range(9):
        (tmp_path / f"s{k}.xml").write_text(f"<mujoco>{many.format(*[f's{k + 1}.xml'] * 10)}</mujoco>")
    (tmp_path / "s9.xml").write_text("<mujoco><worldbody/></mujoco>")
    with pytest.raises(RobotError, match="includes more than 500 files"):
        load_robot(tmp_path / "s0.xml")
    body = '<body><joint axis="1 0 0"/><geom size=".1"/></body>'
    for text in (
        f'<replicate count="100000000">{body}</replicate>',
        '<replicate count="300">' * 3 + body + "</replicate>" * 3,
    ):
        with pytest.raises(RobotError, match="more than"):
            robot_from_text(f"<mujoco><worldbody>{text}</worldbody></mujoco>", "mjcf", "bomb")
