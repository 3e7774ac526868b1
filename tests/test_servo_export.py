"""Exports of models with position drives: MuJoCo repeats the closed loop, other formats hold its numbers."""

from __future__ import annotations

import os
from pathlib import Path

import mujoco
import numpy as np
import pytest
from exported import executed
from servo_loops import SWING, driven, in_mujoco, motion, pendulum

from signid.cli import run
from signid.model import Model, load_model
from signid.output.export import export
from signid.robot import load_robot
from signid.servo.plant import roll_out
from signid.servos import Servo

LOOPS = {
    "effort": SWING,
    "duty": SWING.with_(law="duty"),
    "torque_speed": SWING.with_(law="torque_speed"),
    "effort, saturated": SWING.with_(effort_limit=0.5),
    "duty, saturated": SWING.with_(law="duty", effort_limit=0.6),
    "torque_speed, saturated": SWING.with_(law="torque_speed", effort_limit=0.6, speed_limit=4.0),
    "kd on the error, saturated": SWING.with_(kd_on="error", effort_limit=0.7),
}
CLOSE = 1e-3  # [rad]


@pytest.mark.slow_cases("saturated")
@pytest.mark.parametrize("name", LOOPS)
def test_mujoco_repeats_the_loop_of_a_pendulum(name: str) -> None:
    servo = LOOPS[name]
    model = driven(pendulum(), {"swing": servo})
    grid = motion(model, seed=3)
    expected, found = roll_out(model, model.servos, grid), in_mujoco(model, grid)
    assert np.abs(found - expected).max() < CLOSE
    if np.isfinite(servo.effort_limit):
        assert np.abs(expected - roll_out(model, {"swing": LOOPS[servo.law]}, grid)).max() > 20 * CLOSE, "it is limited"


def so101() -> Path:
    path = Path(os.environ.get("SIGNID_DATA", "/nowhere")) / "so101_sage" / "so101.urdf"
    if not path.is_file():
        pytest.skip("the public recordings are not here")
    return path


def arm(law: str, limit: float) -> Model:
    rng = np.random.default_rng(1)
    model = driven(str(so101()), {})
    numbers = {
        joint: Servo(
            law=law,
            kp=rng.uniform(10, 20),
            kd=rng.uniform(0.4, 0.8),
            delay=rng.uniform(0.005, 0.02),
            effort_limit=limit,
            coulomb_friction=rng.uniform(0.02, 0.1),
            viscous_friction=rng.uniform(0.02, 0.1),
            armature=rng.uniform(0.01, 0.03),
            torque_offset=rng.uniform(-0.05, 0.05),
        )
        for joint in model.robot.joints
    }
    return driven(model.robot, numbers)


@pytest.mark.slow_cases("effort-1.7|duty")
@pytest.mark.parametrize(("law", "limit"), [("effort", np.inf), ("effort", 1.7), ("duty", 2.0)])
def test_mujoco_repeats_the_loop_of_an_arm(law: str, limit: float) -> None:
    model = arm(law, limit)
    grid = motion(model, seed=5)
    expected, found = roll_out(model, model.servos, grid), in_mujoco(model, grid)
    assert np.abs(found - expected).max() < CLOSE
    if np.isfinite(limit):
        free = {joint: servo.with_(effort_limit=np.inf) for joint, servo in model.servos.items()}
        assert (np.abs(expected - roll_out(model, free, grid)).max(axis=0) > 20 * CLOSE).any(), "some are limited"


BEYOND = SWING.with_(load_friction=0.1, dead_band=0.01, profile_speed=4.0, droop=0.002)
CURVED = SWING.with_(law="torque_speed", effort_limit=1.0, speed_limit=6.0)


def test_an_mjcf_says_what_it_lacks() -> None:
    made = export(driven(pendulum(), {"swing": BEYOND}), "mjcf")
    for law in ("motor_friction", "dead_band", "profile_limit", "voltage_droop"):
        assert any(law in note and note.startswith("an MJCF cannot hold") for note in (*made.notes, *made.flags))
        assert law in made.text
    assert not any("cannot hold" in note for note in export(driven(pendulum(), {"swing": SWING}), "mjcf").notes)


def test_joints_without_a_drive_keep_their_motor() -> None:
    there = mujoco.MjModel.from_xml_string(export(driven("3r", {"joint_2": SWING}), "mjcf").text)
    assert [there.actuator(k).name for k in range(3)] == list(load_robot("3r").joints)
    assert there.actuator_biasprm[:, 1].tolist() == [0.0, -SWING.kp, 0.0]


def test_isaac_lab_gets_the_loops(monkeypatch: pytest.MonkeyPatch) -> None:
    duty = SWING.with_(law="duty", effort_limit=0.9)
    made = export(driven("3r", {"joint_1": SWING, "joint_2": duty, "joint_3": CURVED}), "isaaclab")
    groups = executed(made.text, "isaaclab.actuators", monkeypatch)["ACTUATORS"]
    first, second, third = (groups[f"joint_{k}"] for k in (1, 2, 3))
    assert (first.kind, first.stiffness, first.damping, first.friction) == ("DelayedPDActuatorCfg", 8.0, 0.15, 0.08)
    assert (first.min_delay, first.max_delay) == (2, 3), "12.3 ms and half a step, in steps of 5 ms"
    assert first.armature == 0.004 + 0.0025 * 0.15, "explicit damping takes half a step of it"
    assert (second.damping, second.viscous_friction, second.effort_limit) == (0.0, duty.damping, 0.9), (
        "kd is not clipped"
    )
    assert (third.kind, third.saturation_effort, third.velocity_limit) == ("DCMotorCfg", 1.0, 6.0)
    assert any("the delay of joint_3" in note for note in made.notes)
    assert any("torque_offset of joint_1" in note for note in made.notes)


def test_isaac_lab_has_one_group_of_the_joints_without_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    groups = executed(export(driven("3r", {"joint_1": SWING}), "isaaclab").text, "isaaclab.actuators", monkeypatch)
    assert groups["ACTUATORS"]["others"].joint_names_expr == ["joint_2", "joint_3"]


def test_mjlab_gets_the_loops(monkeypatch: pytest.MonkeyPatch) -> None:
    model = driven("3r", {"joint_1": SWING, "joint_3": CURVED})
    first, second, third = executed(export(model, "mjlab").text, "mjlab.actuator", monkeypatch)["ACTUATORS"]
    assert (first.kind, first.frictionloss, first.delay_max_lag) == ("BuiltinPositionActuatorCfg", 0.08, 3)
    assert (first.viscous_damping, first.damping, second.kind) == (0.02, 0.15, "BuiltinMotorActuatorCfg")
    assert (third.kind, third.velocity_limit) == ("DcMotorActuatorCfg", 6.0)


def test_actuators_load_back_with_the_urdf(tmp_path: Path) -> None:
    model = driven("3r", {"joint_2": BEYOND.with_(law="duty", effort_limit=0.9, droop=0.0, kp_register=400.0)})
    made = export(model, "actuators")
    assert made.notes == ()
    (tmp_path / "actuators.toml").write_text(made.text)
    back = load_robot("3r", actuators=tmp_path / "actuators.toml")
    stated = back.servo["joint_2"]
    assert (stated["law"], stated["kp"], stated["load_friction"]) == ("duty", 8.0, 0.1)
    assert (stated["kp_register"], back.actuators.armature[1]) == (400.0, 0.004)


@pytest.mark.parametrize("kind", ["urdf", "function"])
def test_formats_without_drives_say_so(kind: str) -> None:
    assert any("position drives of joint_2" in note for note in export(driven("3r", {"joint_2": SWING}), kind).notes)


def test_the_command_writes_all_formats(tmp_path: Path) -> None:
    saved = driven("3r", {"joint_2": SWING}).save(tmp_path / "model.json")
    files = {"mjlab": "a.py", "ros": "d.yaml", "mjcf": "e.xml"}
    options = [part for kind, name in files.items() for part in (f"--{kind}", str(tmp_path / name))]
    assert run(["export", str(saved), *options]) == 0
    assert all((tmp_path / name).is_file() for name in files.values())
    assert load_model(saved).servos and "joint_2" in (tmp_path / "d.yaml").read_text()
