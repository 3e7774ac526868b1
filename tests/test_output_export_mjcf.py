"""An exported MJCF has the model's torque in MuJoCo, and lists the parameters that it omits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from exported import gripper, model_of, mujoco_torque, states
from toys import BODY as MASS, joint, link, toy

from signid.effects import EFFECTS
from signid.errors import RobotError
from signid.model import Model, load_model
from signid.output.export import export
from signid.robot import hold, load_robot, robot_from_text
from signid.types import Law, Robot

EXACT = {"atol": 1e-9, "rtol": 1e-9}
BODY = "mass=0.5,first_moment_x=0.05,first_moment_y=-0.02,first_moment_z=0.04"

WIDE = "inertia_xx=0.1,inertia_xy=0.01,inertia_yy=0.12,inertia_xz=0,inertia_yz=0.02,inertia_zz=0.15"


def names(robot: Robot) -> list[str]:
    """Joint name of each velocity of the model, empty for joints that stand still."""
    moving = robot.drive.any(axis=1)
    every = list(zip(robot.model.names, robot.model.joints, strict=True))[1:]
    return [str(name) if moving[j.idx_v + k] else "" for name, j in every for k in range(j.nv)]


def everything(robot: Robot) -> Model:
    first, last = robot.joints[0], robot.joints[-1]
    return model_of(
        robot,
        *(f"viscous_friction@{j}:coefficient={k + 1}" for k, j in enumerate(robot.joints)),
        *(f"coulomb_friction@{j}:level={k + 0.5}" for k, j in enumerate(robot.joints)),
        f"armature@{first}:inertia=0.3",
        f"armature@{last}:inertia=0.02",
        f"spring@{first}:stiffness=7,rest=0.3",
        f"spring@{first}:stiffness=2,rest=-0.6",
        f"link_inertia@{first}:{BODY},{WIDE}",
        f"payload:{BODY}",
        "base_tilt:x=0.2,y=-0.1",
    )


@pytest.mark.parametrize("name", ["3r", "panda", "ur5", "emps", "gripper", "double_pendulum_continuous"])
def test_mujoco_has_the_torque_of_the_model(name: str) -> None:
    model = everything(gripper() if name == "gripper" else load_robot(name))
    motion = states(model.robot)
    found = mujoco_torque(export(model, "mjcf").text, motion, names(model.robot))
    np.testing.assert_allclose(found, model.inverse(motion), **EXACT)


def test_joints_that_are_held_are_rigid() -> None:
    parts = [link(x) for x in "abcd"] + [
        joint("free", "a", "b", "floating", ""),
        joint("x", "b", "c"),
        joint("y", "c", "d"),
    ]
    for robot in (toy(*parts), hold(toy(*parts), {"x": 0.4}), hold(load_robot("panda"), {"2": 0.3, "8": 0.01})):
        model, motion = model_of(robot), states(robot)
        made = export(model, "mjcf")
        found = mujoco_torque(made.text, motion, names(robot))
        np.testing.assert_allclose(found, model.inverse(motion), **EXACT)
        assert "held fixed in the model: they are rigid in the MJCF" in made.notes[0]


def test_several_joints_of_one_body_of_an_mjcf() -> None:
    source = """<mujoco><option gravity="1 2 -9"/><worldbody><body name="a" pos="0.1 0 0.2" euler="20 30 0">
      <joint name="x" type="slide" axis="1 1 0"/><joint name="y" axis="0 1 0.5" pos="0.1 0.2 0.3"/>
      <joint name="z" axis="0 0 1" pos="0 0.1 0" damping="2" armature="0.1" frictionloss="0.3"/>
      <inertial mass="2" pos="0.1 0.2 0.1" diaginertia="0.1 0.2 0.15"/>
      <body name="b" pos="0 0 0.3"><joint name="w" axis="1 0 0"/>
      <inertial mass="1" pos="0 0.2 0.1" diaginertia="0.1 0.2 0.15"/></body></body></worldbody></mujoco>"""
    robot = robot_from_text(source, "mjcf", "odd")
    model, motion = model_of(robot), states(robot)
    made = export(model, "mjcf")
    np.testing.assert_allclose(mujoco_torque(made.text, motion, ["x", "y", "z", "w"]), model.inverse(motion), **EXACT)
    np.testing.assert_allclose(mujoco_torque(source, motion, ["x", "y", "z", "w"]), model.inverse(motion), **EXACT)
    assert "shapes, actuators and sensors" in made.notes[-1]
    with pytest.raises(RobotError, match="export to URDF needs a URDF"):
        export(model, "urdf")


@pytest.mark.parametrize("name", ["3r", "panda", "gripper"])
def test_signid_reads_its_own_mjcf(name: str, tmp_path: Path) -> None:
    robot = gripper() if name == "gripper" else load_robot(name)
    first, last = robot.joints[0], robot.joints[-1]
    laws = f"viscous_friction@{first}", f"coulomb_friction@{last}:level=2", f"armature@{first}:inertia=0.1", "payload"
    model, motion = model_of(robot, *laws), states(robot)
    (tmp_path / "robot.xml").write_text(export(model, "mjcf").text)
    back = load_model(tmp_path / "robot.xml")
    assert back.robot.joints == robot.joints
    wanted = model.inverse(motion)
    np.testing.assert_allclose(back.inverse(replace(motion, robot=back.robot)), wanted, **EXACT)


def test_a_mimic_joint_follows() -> None:
    model = model_of(gripper())
    there = mujoco.MjModel.from_xml_string(export(model, "mjcf").text)
    data = mujoco.MjData(there)
    data.joint("finger").qpos = 0.1
    data.ctrl[1] = 5.0
    mujoco.mj_step(there, data, 200)
    turn, finger = (data.joint(name).qpos[0] for name in ("turn", "finger"))
    assert abs(turn) > 0.1 and abs(finger - (0.1 - 2 * turn)) < 0.01 * abs(turn)


def test_motors_ranges_and_omitted_parameters() -> None:
    model = model_of("ur5", "torque_saturation@2:limit=20", "backlash@1", "torque_offset@1", "torque_offset@3")
    made = export(model, "mjcf")
    there = mujoco.MjModel.from_xml_string(made.text)
    robot = model.robot
    np.testing.assert_allclose(there.jnt_range, np.column_stack([robot.lower, robot.upper]))
    most = np.minimum(robot.effort_limit, [np.inf, 20, np.inf, np.inf, np.inf, np.inf])
    np.testing.assert_allclose(there.actuator_forcerange[:, 1], most + there.actuator_biasprm[:, 0])
    np.testing.assert_allclose(there.actuator_forcerange[:, 0], -most + there.actuator_biasprm[:, 0])
    sentence = "an MJCF cannot hold backlash of shoulder_pan_joint"
    assert [flag.partition(":")[0] for flag in made.flags] == [sentence], "the joint has no armature"
    assert sentence in made.text.partition("<mujoco")[0]
    assert there.actuator_biasprm[:, 0].tolist() == [-1.0, 0, -1.0, 0, 0, 0]


def test_negative_numbers_are_omitted_and_reported() -> None:
    robot = load_robot("3r")
    laws = tuple(
        Law(EFFECTS["viscous_friction"], (j,), {"coefficient": x})
        for j, x in ((0, 2.0), (0, -3.0), (1, -0.5), (1, 2.0))
    )
    laws += (Law(EFFECTS["spring"], (2,), {"stiffness": -1.0, "rest": 0.0}),)
    made = export(replace(model_of(robot), laws=laws), "mjcf")
    there = mujoco.MjModel.from_xml_string(made.text)
    np.testing.assert_allclose(there.dof_damping, [0, 1.5, 0])
    said = " ".join((*made.flags, *made.notes))
    assert "an MJCF cannot hold viscous_friction of joint_1, joint_1: " in said and "spring of joint_3" in said


def test_meshes_are_shown_where_they_are_found(tmp_path: Path) -> None:
    there = mujoco.MjModel.from_xml_string(export(model_of("panda"), "mjcf").text)
    assert there.nmesh == 9 and there.ngeom == 17 and not there.geom_contype.any()
    shapes = (
        '<visual><geometry><box size="1 2 3"/></geometry></visual>',
        '<visual><geometry><mesh filename="package://arm/tip.stl" scale="2 2 2"/></geometry></visual>',
        '<visual><geometry><mesh filename="tip.dae"/></geometry></visual>',
    )
    parts = [link(name, MASS + shape) for name, shape in zip("abc", shapes, strict=True)]
    model = model_of(toy(*parts, joint("z", "a", "b"), joint("y", "b", "c")))
    made = export(model, "mjcf")
    assert made.notes[-1] == "no shapes for b, c: their meshes are missing or not readable by MuJoCo"
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [0, 1, 0], [0, 0, 1]]], np.float32)
    faces = b"".join(bytes(12) + face.tobytes() + bytes(2) for face in corners)
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm" / "tip.stl").write_bytes(bytes(80) + len(corners).to_bytes(4, "little") + faces)
    made = export(model, "mjcf", [tmp_path])
    assert "no shapes for c:" in made.notes[-1]
    there = mujoco.MjModel.from_xml_string(made.text)
    assert there.nmesh == 1 and there.ngeom == 2


def test_bodies_without_mass() -> None:
    chain = [link("a"), link("b", ""), link("c"), joint("z", "a", "b"), joint("y", "b", "c")]
    model = model_of(toy(*chain))
    made, motion = export(model, "mjcf"), states(model.robot)
    assert made.notes[-1].startswith("massless links get 1e-12 kg")
    np.testing.assert_allclose(mujoco_torque(made.text, motion, ["z", "y"]), model.inverse(motion), **EXACT)


def test_impossible_bodies_are_exchanged_or_refused() -> None:
    model = model_of("double_pendulum_continuous", f"link_inertia@1:{BODY}", "payload", "viscous_friction@1")
    made, motion = export(model, "mjcf"), states(model.robot)
    note = "inertials are replaced by consistent ones with the same torque, since link1 had inconsistent ones"
    assert note in made.notes
    found = mujoco_torque(made.text, motion, names(model.robot))
    np.testing.assert_allclose(found, model.inverse(motion), **EXACT)
    with pytest.raises(
        RobotError, match="the inertials of wrist_3_link are not physically consistent, as MuJoCo requires"
    ):
        export(model_of("ur5", "link_inertia@6:mass=0,first_moment_x=1,first_moment_y=0,first_moment_z=0"), "mjcf")


def test_an_impossible_payload_becomes_part_of_its_link() -> None:
    model = model_of("3r", "payload:mass=0.01,first_moment_x=0.05,first_moment_y=0,first_moment_z=0,inertia_xx=0.001,"
                     "inertia_xy=0,inertia_yy=0.001,inertia_xz=0,inertia_yz=0,inertia_zz=0.001")  # fmt: skip
    model = replace(model, inertials=model.inertials + np.eye(10)[9] * 0.3 + np.eye(10)[6] * 0.3 + np.eye(10)[4] * 0.3)
    text, motion = export(model, "mjcf").text, states(model.robot)
    assert 'name="payload"' not in text
    np.testing.assert_allclose(mujoco_torque(text, motion, names(model.robot)), model.inverse(motion), **EXACT)
