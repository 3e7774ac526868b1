"""Columns of servos: commanded positions instead of torque, what drives record besides, and stated numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bags import JOINTS, NEW, OLD, START, control, point, store, swung, write2
from test_recording import arm

import signid
from signid.errors import RecordingError, RobotError
from signid.recording.match import guess
from signid.recording.read import read_bare
from signid.recording.reading import draft_map
from signid.types import Array, Robot

ROWS = 300


@pytest.fixture(scope="module")
def robot() -> Robot:
    return signid.load_robot("3r")


def columns(joints: int = 3) -> dict[str, Array]:
    t = np.arange(ROWS) / 100
    found = {"t": t}
    for j in range(1, joints + 1):
        found[f"q_des_{j}"] = np.sin(t + j)
        found[f"q_{j}"] = np.sin(t + j - 0.05)
    return found


def test_servo_recording_without_torque(robot: Robot) -> None:
    more = {"on_1": np.ones(ROWS), "pwm_2": np.full(ROWS, 0.5), "tau_ff_joint_3": np.full(ROWS, 2.0)}
    recording = signid.read_recording({**columns(), **more}, robot)
    assert recording.servo == (True, True, True)
    samples = recording.read(10, 20)
    assert samples.servo is not None and samples.servo.dq_des is None and samples.servo.volt is None
    assert samples.servo.on is not None and samples.servo.on.shape == (10, 3)
    assert samples.servo.on[:, 0].tolist() == [1.0] * 10 and np.isnan(samples.servo.on[:, 1:]).all()
    assert samples.servo.tau_ff is not None and samples.servo.tau_ff[0, 2] == 2
    assert np.isnan(samples.tau).all()
    assert recording.read(servo=False).servo is None
    assert any("servos" in note for note in recording.notes)


def test_torque_makes_no_servo(robot: Robot) -> None:
    recording = signid.read_recording(
        {**columns(), "tau_2": np.ones(ROWS), "current_3": np.ones(ROWS)}, robot, unsigned=True
    )
    assert recording.servo == (True, False, False)
    assert recording.read().servo is None


@pytest.mark.parametrize("verb", ["payload", "roll_out"])
def test_torque_verbs_refuse_servos(robot: Robot, verb: str) -> None:
    recording = signid.read_recording(columns(), robot)
    model = signid.load_model("3r")
    calls = {
        "payload": lambda: signid.payload(
            robot, [recording], [signid.read_recording({**columns(), "dq_1": np.ones(ROWS)}, robot)]
        ),
        "roll_out": lambda: signid.roll_out(model, [recording]),
    }
    with pytest.raises(RecordingError, match="commanded and measured positions, but no torque") as error:
        calls[verb]()
    assert "\n" not in str(error.value)


def test_neither_torque_nor_command(robot: Robot) -> None:
    given = {name: values for name, values in columns().items() if "des" not in name}
    with pytest.raises(RecordingError, match="no torque of a joint"):
        signid.read_recording(given, robot)


def test_units_of_drives(robot: Robot) -> None:
    given = {**columns(), "pwm_1": np.full(ROWS, 50.0), "volt_1": np.full(ROWS, 74.0), "dq_des_1": np.full(ROWS, 180.0)}
    units = {"units": {"pwm": "%", "volt": "dV", "dq_des": "deg/s"}}
    servo = signid.read_recording(given, robot, columns=units).read().servo
    assert servo is not None and servo.pwm is not None and servo.volt is not None and servo.dq_des is not None
    assert [each[0, 0] for each in (servo.pwm, servo.volt, servo.dq_des)] == pytest.approx([0.5, 7.4, np.pi])


def test_implausible_duties_are_ignored(robot: Robot) -> None:
    recording = signid.read_recording({**columns(), "pwm_1": np.full(ROWS, 885.0)}, robot)
    assert recording.read().servo is None
    assert any("pwm_1" in note and "-1 to 1" in note for note in recording.flags)


STATED = """
[joint.1]
armature = 0.1
[joint.1.servo]
law = "duty"
kp = 20
kd_on = "error"
delay = "find"
kp_register = 400
[joint.joint_2.servo]
kp = "find"
[recording."kp100.csv".joint_1]
kp_register = 100
"""


def test_stated_numbers_of_drives(tmp_path: Path) -> None:
    file = tmp_path / "drives.toml"
    file.write_text(STATED)
    robot = signid.load_robot("3r", actuators=file)
    assert robot.actuators.armature[0] == 0.1
    assert robot.servo == {"joint_1": {"law": "duty", "kp": 20.0, "kd_on": "error", "kp_register": 400.0}}
    assert robot.registers == {("kp100.csv", "joint_1"): {"kp_register": 100.0}}
    held = signid.load_robot("3r", actuators=file, lock={"joint_1": 0})
    assert not held.servo and not held.registers
    assert not signid.load_robot("3r").servo and not signid.load_robot("3r").registers


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[joint.1.servo]\nkpp = 1", "did you mean kp"),
        ("[joint.1.servo]\nflavour = 1", "choose from law, kp"),
        ("[joint.1.servo]\nkp = '20'", "expected a finite number"),
        ("[joint.1.servo]\nkp = true", "expected a finite number"),
        ("[joint.1.servo]\nkp = 0", "expected a positive number"),
        ("[joint.1.servo]\nkd = -1", "expected zero or a positive number"),
        ("[joint.1.servo]\neffort_limit = inf", "expected a finite number"),
        ("[joint.1.servo]\ndelay = nan", "expected a finite number"),
        ("[joint.1.servo]\nlaw = 'torque-speed'", "did you mean 'torque_speed'"),
        ("[joint.1.servo]\nlaw = 3", "expected effort, duty, torque_speed or find"),
        ("[joint.1.servo]\nkd_on = 'nothing'", "expected velocity, error or find"),
        ("[joint.1]\nservo = 3", "write .joint.1.servo."),
        ("[joint.1]\nkp = 3", "kp belongs below .joint.1.servo."),
        ("[joint.9.servo]\nkp = 3", "no joint '9'"),
        ("recording = 3", "'recording' is not a table"),
        ('[recording]\n"a.csv" = 3', "is not a table of joints"),
        ('[recording."a.csv"]\n1 = 3', "no table of numbers"),
        ("[recording.a.csv.1]\nkp_register = 3", "with its quotes"),
        ('[recording."a.csv".1]\nkp = 3', "expected kp_register"),
        ('[recording."a.csv".1]\nkp_register = 0', "expected a positive number"),
        ('[recording."a.csv".nobody]\nkp_register = 1', "no joint 'nobody'"),
        ('[recording."a.csv".1]\nkp_register = 1\n[recording."a.csv".joint_1]\nkp_register = 1', "two tables"),
    ],
)
def test_bad_numbers_of_drives_get_a_sentence(text: str, sentence: str, tmp_path: Path) -> None:
    file = tmp_path / "drives.toml"
    file.write_text(text)
    with pytest.raises(RobotError, match=sentence) as caught:
        signid.load_robot("3r", actuators=file)
    assert "\n" not in str(caught.value) and str(caught.value).startswith("drives.toml: ")


GUESSES = {
    "goal_position_2": ("q_des", "2"),
    "elbow_present_position": ("q", "elbow"),
    "goal_velocity_elbow": ("dq_des", "elbow"),
    "present_pwm_3": ("pwm", "3"),
    "present_input_voltage_3": ("volt", "input_3"),
    "present_voltage_3": ("volt", "3"),
    "present_temperature_3": ("temp", "3"),
    "torque_enable_3": ("on", "3"),
    "tau_ff_1": ("tau_ff", "1"),
    "joint1_torque_feedforward": ("tau_ff", "joint_1"),
    "on_time": ("t", ""),
}


def test_meaning_of_names_of_drives() -> None:
    found = {column: guess(column, {"1", "2", "3"}) for column in GUESSES}
    assert {column: one and (one.kind, one.joint) for column, one in found.items()} | {"on_time": ("t", "")} == GUESSES


def test_draft_of_a_log_of_servos(robot: Robot, tmp_path: Path) -> None:
    t = np.arange(ROWS) / 100
    log = {"time": t}
    for j in (1, 2, 3):
        log[f"goal_position_{j}"], log[f"present_position_{j}"] = np.sin(t + j), np.sin(t + j - 0.05)
        log[f"present_pwm_{j}"] = np.where(np.sin(t) < 0, 65536.0, 0.0) + np.rint(800 * np.sin(t))
        log[f"present_voltage_{j}"] = np.full(ROWS, 74.0)
        log[f"torque_enable_{j}"] = np.ones(ROWS)
    draft = draft_map(log, robot)
    assert not draft.lacking and not draft.unused, draft.text
    file = tmp_path / "map.toml"
    file.write_text(draft.text)
    recording = signid.read_recording(log, robot, columns=file)
    servo = recording.read().servo
    assert recording.servo == (True, True, True) and servo is not None
    assert servo.pwm is not None and servo.volt is not None and servo.on is not None
    np.testing.assert_allclose(servo.pwm[:, 1], np.rint(800 * np.sin(t)) / 885)
    assert servo.volt[0, 0] == pytest.approx(7.4) and (servo.on == 1).all()


@pytest.mark.parametrize("parts", [OLD, NEW], ids=["desired", "reference"])
def test_a_controllers_state_without_effort(parts: tuple[str, str], tmp_path: Path) -> None:
    known, (t, q, dq, _) = store(False, parts), swung()
    messages = []
    for k, stamp in enumerate(START + t):
        asked, done = point(known, 0, q[k] + 1, dq[k]), point(known, 0, q[k])
        messages.append(("/arm/state", control(known, int(stamp), JOINTS, asked, done), int(stamp)))
    recording = signid.read_recording(write2(tmp_path / "a", known, messages), arm())
    samples = recording.read()
    assert recording.servo == (True, True, True) and samples.servo is not None
    order = [JOINTS.index(joint) for joint in recording.joints]
    assert samples.q_des is not None and samples.servo.dq_des is not None
    np.testing.assert_array_equal(samples.q_des, q[:, order] + 1)
    np.testing.assert_array_equal(samples.servo.dq_des, dq[:, order])
    assert "a recording of servos" in "; ".join(recording.notes)


def test_commands_and_positions_are_found_by_the_words_in_their_names() -> None:
    t = np.arange(300) * 0.01
    columns = {"time [ms]": 1e3 * t, "FR_0_target": np.sin(t), "FR_0_actual": np.sin(t - 0.05), "FR_0_kp": 0 * t}
    named = {"m1_cmd [deg]": 40 * np.sin(t), "m1_pos [deg]": 40 * np.sin(t - 0.05)}
    recording, units = read_bare({**columns, **named})
    assert recording.joints == ("fr_0", "m_1") and units == {"fr_0": "", "m_1": "rad"}
    samples = recording.read()
    np.testing.assert_allclose(samples.t, t, atol=1e-12)
    np.testing.assert_allclose(samples.q, np.column_stack([np.sin(t - 0.05), np.radians(40 * np.sin(t - 0.05))]))
    assert any("fr_0 is FR_0_target" in note for note in recording.notes)
    with pytest.raises(RecordingError, match="no joint J with both columns"):
        read_bare({"t": t, "speed_1": t, "kp_1": t})
