"""Names of columns as they come, matched to kinds of signals and to joints; lines to choose for the others."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import signid
from signid.cli import run
from signid.errors import RecordingError
from signid.recording import read_recording
from signid.recording.mapping import calibrated, read_calibration
from signid.recording.match import NUMBER, guess, guess_columns, match_signals
from signid.recording.reading import draft_map
from signid.recording.vocabulary import VOCABULARY, kinds_of
from signid.robot import robot_from_text

TIMES = {  # columns of time and their units, "" where the name has none
    **{
        name: ""
        for name in (
            *("Zeit", "Uhrzeit", "Zeitpunkt", "temps", "horodatage", "tiempo", "marca_de_tiempo", "tempo", "istante"),
            *("elapsed", "log_time", "logTime", "stamps", "unix_time", "time_since_start", "header_stamp", "sys_time"),
        )
    },
    **{
        "Zeitstempel_ms": "ms",
        "Zeitmarke_us": "us",
        "Zeit_in_s": "s",
        "horodatage_ns": "ns",
        "marca_temporal_us": "us",
    },
    **{"temps_écoulé_ms": "ms", "tempo_trascorso_s": "s", "hora_ms": "ms", "log_time_us": "us", "TimeUS": "us"},
    **{
        "Zeitmarke_us": "us",
        "secs": "s",
        "millis": "ms",
        "Sekunden": "s",
        "milisegundos": "ms",
        "ticks_us": "us",
        "tick_ms": "ms",
    },
}
NO_TIMES = ("cycle_time", "time_constant", "delay_time", "t_motor", "time_1", "stamp.secs", "stamp.nsecs", "s", "h")
LEG = [f"FR_{part}_joint" for part in ("hip", "thigh", "calf")]
UR = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
CASES: dict[str, tuple[str, dict[str, str]]] = {  # robot, and the signal of each column; "" for none
    "places in a leg": (
        "go2",
        {
            **{f"FR_{k}_actual": f"q_{joint}" for k, joint in enumerate(LEG)},
            **{f"FR_{k}_target": f"q_des_{joint}" for k, joint in enumerate(LEG)},
            "RR_2_actual": "q_RR_calf_joint",
        },
    ),
    "numbers from zero, whatever the joint is named": (
        "panda",
        {
            **{f"q_{k}": f"q_panda_joint{k + 1}" for k in range(7)},
            **{f"tau_J_{k}": f"tau_panda_joint{k + 1}" for k in range(7)},
            "dq_1": "dq_panda_joint2",  # from zero as well, although there is no dq_0
            "tau_ext_hat_filtered_0": "",
        },
    ),
    "elements of arrays": (
        "3r",
        {
            **{f"/joint_states/position[{k}]": f"q_joint_{k + 1}" for k in range(3)},
            **{f"/joint_states/effort.{k}": f"tau_joint_{k + 1}" for k in range(3)},
            "/joint_states/velocity[2]": "dq_joint_3",
        },
    ),
    "targets beside actual values": (
        "ur5",
        {
            **{f"target_q_{k}": f"q_des_{joint}" for k, joint in enumerate(UR)},
            **{f"actual_q_{k}": f"q_{joint}" for k, joint in enumerate(UR)},
            "actual_TCP_pose_0": "",
            "position_error_0": "",
        },
    ),
    "commands beside bare motors": (
        "3r",
        {**{f"m{k}_cmd": f"q_des_joint_{k + 1}" for k in range(3)}, **{f"m{k}": f"q_joint_{k + 1}" for k in range(3)}},
    ),
    "German": (
        "ur5",
        {
            **{f"Achse{k}_Ist_Grad": f"q_{joint}" for k, joint in enumerate(UR, 1)},
            **{f"Achse{k}_Soll_Grad": f"q_des_{joint}" for k, joint in enumerate(UR, 1)},
            "Achse2_Istgeschwindigkeit_Grad/s": "dq_shoulder_lift_joint",
            "Achse2_Drehmoment_Nm": "tau_shoulder_lift_joint",
            "Achse3_Strom_A": "current_elbow_joint",
        },
    ),
    "French and Spanish": (
        "3r",
        {
            "position_axe1": "q_joint_1",
            "consigne_position_axe2": "q_des_joint_2",
            "couple_axe1": "tau_joint_1",
            "velocidad_eje3": "dq_joint_3",
        },
    ),
    "whole names of joints inside paths": (
        "ur5",
        {
            **{f"/joint_states/{joint}/position": f"q_{joint}" for joint in UR},
            **{f"/joint_states/{joint}/effort": f"tau_{joint}" for joint in UR},
        },
    ),
    "one joint needs no name": (
        "1r",
        {"pos": "q_joint_1", "cmd": "q_des_joint_1", "axis0.motor.Iq_measured": "current_joint_1", "d_current": ""},
    ),
    "derivatives": ("3r", {"theta_1": "q_joint_1", "theta_dot_1": "dq_joint_1", "dtheta2": "dq_joint_2"}),
    "estimates of quadrupeds": (
        "go2",
        {
            "motor_state[0].q": "q_FL_hip_joint",
            "motor_cmd[0].q": "q_des_FL_hip_joint",
            "motor_state[0].tau_est": "tau_FL_hip_joint",
            "motor_cmd[0].kp": "",
        },
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_names_of_columns_are_matched(case: str) -> None:
    name, expected = CASES[case]
    robot = signid.load_robot(name)
    found = {one.column: key for key, one in match_signals(guess_columns(list(expected), robot), robot)}
    assert {column: found.get(column, "") for column in expected} == expected


T = np.arange(500) * 0.02
SERVOS = ("Rotation", "Pitch", "Elbow", "Wrist_Pitch", "Wrist_Roll", "Claw")
PAIRED = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")


def arm_log() -> dict[str, np.ndarray]:
    columns = {"t": T}
    for k, name in enumerate(SERVOS):
        columns |= {f"q_{name}": 0.3 * np.sin((1 + 0.2 * k) * T), f"q_des_{name}": 0.3 * np.sin((1 + 0.2 * k) * T)}
    return columns


def test_joints_that_no_column_fits_are_lines_to_choose() -> None:
    robot = signid.load_robot("so101")
    drafted = draft_map(arm_log(), robot)
    assert '# q_shoulder_pan = "q_Rotation"  # which?' in drafted.text
    known = {f"q_{joint}": f"q_{name}" for joint, name in zip(PAIRED, SERVOS, strict=True)}
    chosen = tomllib.loads(drafted.text.replace("# q_", "q_"))
    assert {key: chosen["columns"][key] for key in known} == known
    whole = read_recording(arm_log(), robot, columns=chosen)
    assert set(whole.joints) == set(robot.joints) and not whole.flags
    part = read_recording(arm_log(), robot, columns=tomllib.loads(drafted.text))
    assert set(part.joints) < set(robot.joints) and "has no such joint: q_Rotation" in part.flags[0]
    with pytest.raises(RecordingError, match="q_Rotation names no joint"):
        read_recording(arm_log(), robot)


def test_a_drafted_map_converts_to_a_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    pl.DataFrame(arm_log()).write_csv("log.csv")
    arguments = ["convert", "log.csv", "--robot", "so101", "-o", "recording.csv"]
    assert run(arguments) == 3 and not Path("recording.csv").exists()
    assert "lines of its reading, log.csv.reading.toml, are to be chosen" in capsys.readouterr().err
    assert run(arguments) == 3
    assert "left out, because so101_new_calib has no such joint: q_Rotation" in capsys.readouterr().err
    assert len(read_recording("recording.csv", signid.load_robot("so101")).joints) == 2


def test_the_calibration_states_per_cent(tmp_path: Path) -> None:
    file = tmp_path / "follower.json"
    motors = {
        name: {"id": 1, "drive_mode": 0, "homing_offset": 7, "range_min": 1024, "range_max": 3072} for name in PAIRED
    }
    file.write_text(json.dumps(motors), encoding="utf-8")
    ranges = read_calibration(file)
    angle = 2048 * 2 * np.pi / 4095
    percent = {"shoulder_pan": np.array([-98.0, 40.0]), "gripper": np.array([2.0, 90.0])}
    found = calibrated(percent, ranges)
    pan, gripper = found["shoulder_pan"].change, found["gripper"].change
    assert pan is not None and gripper is not None
    np.testing.assert_allclose(pan.apply(np.array([-100.0, 0.0, 100.0])), [-angle / 2, 0.0, angle / 2])
    np.testing.assert_allclose(gripper.apply(np.array([0.0, 50.0, 100.0])), [-angle / 2, 0.0, angle / 2], atol=1e-12)
    assert "CHECK" not in found["shoulder_pan"].why, "98 degrees are beyond half of the range of 180"
    assert "may be degrees: CHECK" in calibrated({"shoulder_pan": np.array([-60.0, 40.0])}, ranges)["shoulder_pan"].why
    assert calibrated({"shoulder_pan": np.array([-130.0, 40.0])}, ranges)["shoulder_pan"].change is None
    log = {"t": T, "q_shoulder_pan": 95 * np.sin(T), "q_des_shoulder_pan": 95 * np.sin(T)}
    columns = tomllib.loads(draft_map(log, signid.load_robot("so101"), ranges=ranges).text)
    read = read_recording(log, signid.load_robot("so101"), columns=columns).read()
    np.testing.assert_allclose(read.q[:, 0], 0.95 * angle / 2 * np.sin(T), atol=1e-9)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[]", "is no calibration of LeRobot"),
        ("{}", "names no motor"),
        ('{"a": 1}', "is no calibration of LeRobot"),
        ('{"a": {"range_min": 9, "range_max": 3}}', "has no valid range of a"),
        ('{"a": {"range_min": 0, "range_max": 1e9}}', "has no valid range of a"),
        ("nonsense", "is no calibration of LeRobot"),
    ],
)
def test_invalid_calibrations_are_refused(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "c.json").write_text(text, encoding="utf-8")
    with pytest.raises(RecordingError, match=sentence):
        read_calibration(tmp_path / "c.json")


def test_words_of_time_in_five_languages_and_their_units() -> None:
    found = {name: guess(name) for name in TIMES}
    assert {name: (one.kind, one.unit) if one else None for name, one in found.items()} == {
        name: ("t", unit) for name, unit in TIMES.items()
    }
    assert [name for name in NO_TIMES if (one := guess(name)) and one.kind == "t"] == []


def test_every_word_of_time_and_of_joints_is_one_wherever_names_are_read() -> None:
    words = {side: [w for w, x in VOCABULARY.items() if side in (x.kind, x.side)] for side in ("t", "joint")}
    assert [word for word in words["t"] if kinds_of(word) != {"t"} or getattr(guess(word), "kind", "") != "t"] == []
    assert [word for word in words["joint"] if not NUMBER.fullmatch(f"{word}01")] == []


def test_ticks_are_time_beside_positions_of_joints_and_counts_where_a_time_stands_beside_them() -> None:
    robot = signid.load_robot("3r")
    alone, beside = guess_columns(["ticks", "q_1"], robot), guess_columns(["time", "ticks", "q_1"], robot)
    assert [one.kind for one in alone] == ["t", "q"]
    assert [one.column for one in beside] == ["time", "q_1"]


def test_short_words_and_accents() -> None:
    kinds = {name: (one.kind, one.joint) for name in ("ang_1", "torq_2", "jtor_3", "ang_vel_1") if (one := guess(name))}
    assert kinds == {"ang_1": ("q", "1"), "torq_2": ("tau", "2"), "jtor_3": ("tau", "3"), "ang_vel_1": ("dq", "1")}
    found = guess("posición_brazo")
    assert found and (found.kind, found.joint) == ("q", "brazo")


def test_letters_of_joints_count_as_the_numbers_of_columns_do() -> None:
    text = signid.load_robot("ur5").document
    for number, letter in zip("123", "abc", strict=True):
        text = text.replace(f'"wrist_{number}_joint"', f'"gelenk_hand_{letter}"')
    robot = robot_from_text(text, "urdf", "arm")
    names = [f"{kind}_Hand{k}_{unit}" for kind, unit in (("Winkel", "Grad"), ("Strom", "mA")) for k in (1, 2, 3)]
    found = dict(match_signals(guess_columns(names, robot), robot))
    assert {key: one.column for key, one in found.items()} == {
        f"{kind}_gelenk_hand_{letter}": names[3 * i + k]
        for i, kind in enumerate(("q", "current"))
        for k, letter in enumerate("abc")
    }
