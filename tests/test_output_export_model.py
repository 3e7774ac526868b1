"""A model exported as URDF, actuators file and Python function is the same model; omissions are reported."""

from __future__ import annotations

import importlib.util
import tomllib
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from exported import COUNT, gripper, model_of, mujoco_torque, states
from lxml import etree

from signid.effects import EFFECTS
from signid.effects.base import Effect, TorqueLaw
from signid.effects.law import candidate_places, law_torque
from signid.errors import OptionError
from signid.model import Model, load_model
from signid.output.export import export
from signid.regression.motion import Motion
from signid.robot import load_robot, robot_from_text
from signid.types import Array, Coefficient, Law

PAYLOAD = "payload:mass=0.3,first_moment_x=0.06,first_moment_y=0.01,first_moment_z=-0.02"
EXACT = {"atol": 1e-9, "rtol": 1e-9}


def imported(text: str, folder: Path) -> ModuleType:
    path = folder / "laws.py"
    path.write_text(text)
    spec = importlib.util.spec_from_file_location("laws_of_a_model", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def acting(model: Model, motion: Motion) -> Motion:
    """The motion of the reshaped bodies without rotors, as laws see it."""
    whole = model.bodies()
    whole.armature = np.zeros(whole.nv)
    return replace(motion, robot=replace(motion.robot, model=whole))


def called(module: ModuleType, motion: Motion, **more: bool) -> Array:
    """The function at every sample, given what it asks for."""
    code = module.torque.__code__
    asked = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    found = []
    for i in range(len(motion)):
        extra = {"t": motion.t[i], "load": motion.load[i], "jacobian": motion.jacobian[i]}
        given = {key: x for key, x in extra.items() if key in asked}
        found.append(module.torque(motion.q[i], motion.v[i], motion.a[i], **given, **more))
    return np.array(found)


def function_effects() -> list[Effect]:
    named = [*EFFECTS, EFFECTS["empirical"]]
    laws = [e for e in named if isinstance(e, TorqueLaw) and not e.memory or e.name == "armature"]
    assert len(laws) >= 18
    return laws


@pytest.mark.parametrize("effect", function_effects(), ids=lambda effect: effect.name)
def test_every_law_of_the_motion_is_the_same_function(effect: Effect, tmp_path: Path) -> None:
    robot = gripper()
    rng = np.random.default_rng(3)
    laws = []
    for place in candidate_places(effect, 2):
        vary = {
            k: x * rng.uniform(0.5, 1.5) if isinstance(effect.parameters[k], Coefficient) else x
            for k, x in effect.example.items()
        }
        laws += [Law(effect, place, vary)] * 2
    model = Model(robot, model_of(robot).inertials, tuple(laws))
    motion = acting(model, states(robot))
    made = export(model, "function")
    wanted = np.zeros((COUNT, 2))
    for law in laws:
        rows, torque = law_torque(law, motion)
        wanted[:, list(rows)] += torque
    found = called(imported(made.text, tmp_path), motion)
    np.testing.assert_allclose(found, wanted, atol=1e-12 * np.abs(wanted).max(), rtol=1e-12)
    assert made.notes == ()


@pytest.mark.parametrize("name", ["3r", "panda", "gripper"])
def test_files_and_function_together_are_the_model(name: str, tmp_path: Path) -> None:
    """The torque of the model is that of its URDF in Pinocchio, or its MJCF in MuJoCo, and of the function."""
    robot = gripper() if name == "gripper" else load_robot(name)
    first, second = robot.joints[:2]
    model = model_of(
        robot, PAYLOAD, f"viscous_friction@{first}", f"coulomb_friction@{second}", f"armature@{first}:inertia=0.2",
        f"torque_offset@{second}", f"stribeck_friction@{first}", f"load_friction@{second}", "fluid_drag",
        f"asymmetric_friction@{second}", f"spring@{first}", f"joint_coupling@{first}:partner={second}", "base_tilt",
    )  # fmt: skip
    motion = states(robot)
    module = imported(export(model, "function").text, tmp_path)
    mine = acting(model, motion)
    back = robot_from_text(export(model, "urdf").text, "urdf", name)
    whole = back.model.copy()
    whole.gravity.linear = np.array(module.GRAVITY)
    urdf = replace(motion, robot=replace(back, model=whole))
    np.testing.assert_allclose(urdf.load + called(module, mine), model.inverse(motion), **EXACT)
    mjcf = mujoco_torque(export(model, "mjcf").text, motion, [str(x) for x in list(robot.model.names)[1:]])
    np.testing.assert_allclose(mjcf + called(module, mine, mjcf=True), model.inverse(motion), **EXACT)


def test_urdf_and_actuators_file_load_as_the_model(tmp_path: Path) -> None:
    model = model_of(
        "ur5", PAYLOAD, "viscous_friction@1", "viscous_friction@1", "coulomb_friction@2:level=3", "armature@6",
        "torque_offset@3:offset=-2", "link_inertia@2",
    )  # fmt: skip
    urdf, drives = export(model, "urdf"), export(model, "actuators")
    (tmp_path / "robot.urdf").write_text(urdf.text)
    (tmp_path / "actuators.toml").write_text(drives.text)
    motion = states(model.robot)
    back = load_model(str(tmp_path / "robot.urdf"))
    np.testing.assert_allclose(back.inverse(motion), model.inverse(motion), **EXACT)
    armature, offset = urdf.flags
    assert armature.startswith("a URDF cannot hold armature of wrist_3_joint: ") and urdf.notes == ()
    assert offset.startswith("a URDF cannot hold torque_offset of elbow_joint: ")
    assert urdf.text.startswith('<?xml version="1.0" encoding="utf-8"?>\n<!-- a URDF cannot hold armature of wrist_3')
    (payload,), (link,) = drives.flags, drives.notes
    assert payload.startswith("an actuators file cannot hold payload of wrist_3_joint: ")
    assert link == "an actuators file cannot hold link_inertia of shoulder_lift_joint, below 2 % of the torque"
    alone = load_model("ur5", tmp_path / "actuators.toml")
    bodies = replace(model, laws=tuple(law for law in model.laws if law.effect.name not in ("payload", "link_inertia")))
    np.testing.assert_allclose(alone.inverse(motion), bodies.inverse(motion), **EXACT)


def test_friction_that_the_model_lacks_does_not_stay() -> None:
    robot = load_robot("panda")
    bare = Model(robot, model_of(robot).inertials, ())
    back = robot_from_text(export(bare, "urdf").text, "urdf", "panda")
    assert not np.nan_to_num(back.actuators.viscous_friction).any()
    assert "viscous_friction = 0.0" in export(bare, "actuators").text
    assert export(model_of("3r"), "urdf").text == load_robot("3r").document


def test_laws_without_a_function_are_named(tmp_path: Path) -> None:
    model = model_of(
        "3r", PAYLOAD, "backlash@1", "presliding_friction@2", "time_delay", "torque_saturation@3", "base_tilt"
    )
    made = export(model, "function")
    imported(made.text, tmp_path)
    for part in (
        "payload of joint_3, held by urdf, mjcf",
        "presliding_friction of joint_2; torque_saturation of joint_3; base_tilt, held by mjcf",
        "time_delay (torque recorded 4.0 ms late), an error of the recording, not of the robot",
    ):
        assert f"\n# this file cannot hold {part}\n" in made.text
    assert len(made.notes) == 3 and len(made.flags) == 1 and "backlash of joint_1: " in made.flags[0]


def test_names_cannot_break_out_of_a_file(tmp_path: Path) -> None:
    evil = 'x"""\nraise SystemExit\n"""\\ --> ] #'
    robot = gripper()
    model = replace(model_of(robot, "torque_offset@1"), robot=replace(robot, name=evil, joints=("a]b\n", evil)))
    module = imported(export(model, "function").text, tmp_path)
    assert module.JOINTS == ("a]b\n", evil)
    assert list(tomllib.loads(export(model, "actuators").text)["joint"]) == ["a]b\n"]
    etree.fromstring(export(replace(model, robot=replace(model.robot, joints=(evil, "b"))), "urdf").text.encode())


def test_there_is_no_other_kind() -> None:
    with pytest.raises(OptionError, match="no export to 'sdf'; choose from urdf, mjcf, actuators, function"):
        export(model_of("1r"), "sdf")
