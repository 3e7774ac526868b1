"""A user's own log in two commands: a complete column map is written from names and numbers, then used."""

from __future__ import annotations

import shlex
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import signid
from signid.cli import run
from signid.cli.terminal import write_error
from signid.errors import RecordingError
from signid.recording import read_recording
from signid.recording.match import guess
from signid.recording.reading import draft_map

ROBOT = signid.load_robot("3r")
T = np.arange(400) * 0.004
Q = np.column_stack([np.sin(3 * T), 0.7 * np.sin(5 * T + 1), 1.1 * np.cos(4 * T)])
V = np.column_stack([3 * np.cos(3 * T), 3.5 * np.cos(5 * T + 1), -4.4 * np.sin(4 * T)])
TAU = np.column_stack([5 * np.cos(3 * T), 4 * np.sin(5 * T), 2 * np.sin(4 * T)])

NAMES = {  # column -> kind, joint in the source, unit
    "joint_1/position": ("q", "joint_1", ""),
    "joint_1.effort": ("tau", "joint_1", ""),
    "pos_j1": ("q", "j_1", ""),
    "actual_q_0": ("q", "0", ""),
    "target_q_0": ("q_des", "0", ""),
    "actual_qd_0": ("dq", "0", ""),
    "current_3": ("current", "3", ""),
    "current_position_3": ("q", "3", ""),
    "q_d_1": ("q_des", "1", ""),
    "tau_abs_1": ("abs_tau", "1", ""),
    "abs_current_2": ("abs_current", "2", ""),
    "motorEff2": ("tau", "motor_2", ""),
    "trq1_mNm": ("tau", "1", "mN.m"),
    "Achse 1 Istposition [deg]": ("q", "achse_1", "deg"),
    "Motor1 load": ("tau", "motor_1", ""),
    "speed_2 (rpm)": ("dq", "2", "rpm"),
    "goal_position_2": ("q_des", "2", ""),
    "elbow_ref_pos": ("q_des", "elbow", ""),
    "jointpos1": ("q", "joint_1", ""),
    "encoder_1": ("q", "1", ""),
    "motor_velocity_deg_s_1": ("dq", "motor_1", "deg/s"),
    "Achse1_Ist_Grad": ("q", "achse_1", "deg"),
    "elbow_ref": ("q_des", "elbow", ""),
    "m0_cmd": ("q_des", "m_0", ""),
    "action.elbow.pos": ("q_des", "elbow", ""),
    "observation.state.elbow.pos": ("q", "elbow", ""),
    "qdes1[deg]": ("q_des", "1", "deg"),
    "SetPoint1": ("q_des", "1", ""),
    "time_us": ("t", "", "us"),
    "Zeit [ms]": ("t", "", "ms"),
}


@pytest.mark.parametrize("name", NAMES)
def test_usual_names_have_a_meaning(name: str) -> None:
    found = guess(name, ("1", "2", "3", "joint_1"))
    assert found is not None and not found.desired
    assert (found.kind, found.joint, found.unit) == NAMES[name]


def test_commanded_torques_are_no_measurements() -> None:
    found = guess("target_moment_0")
    assert found is not None and found.desired
    unnamed = guess("position")
    assert guess("mode") is None and unnamed is not None and not unnamed.joint


def by_joint(pattern: str, values: np.ndarray, first: int = 1) -> dict[str, np.ndarray]:
    return {pattern.format(j + first): values[:, j] for j in range(3)}


COUNTS = np.rint(2048 + Q * 2048 / np.pi)
LOGS: dict[str, tuple[dict[str, np.ndarray], tuple[str, ...]]] = {
    "milliseconds since 1970, degrees, slashes and dots": (
        {
            "stamp": np.rint(T * 1e3) + 1.7e12,
            **by_joint("joint_{}/position", 90 * Q),
            **by_joint("joint_{}.effort", TAU),
        },
        ('t = "ms"  # begins at 1.7e+12', 'q = "deg"  # joint_3 goes from -99', 'tau = "N.m"'),
    ),
    "from zero, with velocities in degrees": (
        {
            "timestamp": T,
            **by_joint("actual_q_{}", Q, 0),
            **by_joint("actual_qd_{}", np.degrees(V), 0),
            **by_joint("target_q_{}", Q, 0),
            **by_joint("actual_moment_{}", TAU, 0),
        },
        ('dq = "deg/s"', 'q_des = "rad"', 'q_joint_3 = "actual_q_2"'),
    ),
    "encoder counts, milliamperes, nanoseconds": (
        {"time": T * 1e9, **by_joint("enc_{}", COUNTS), **by_joint("motor_current_{}", np.rint(1000 * TAU))},
        ("encoder counts; 4096 a turn and zero at 2048", "scale = 0.00153398", 'current = "mA"', 't = "ns"'),
    ),
    "small torques without signs": (
        {"t": T, **by_joint("q_{}", Q), **by_joint("trq_{}", 1e3 * abs(TAU))},
        ('abs_tau_joint_1 = "trq_1"', 'abs_tau = "mN.m"  # joint_1 reaches 5000', 't = "s"'),
    ),
}


def test_commands_without_a_word_for_positions_are_to_be_checked() -> None:
    named = {"t": T, **by_joint("m{}_pos", Q), **by_joint("m{}_torque[%]", TAU)}
    drafted = draft_map({**named, **by_joint("m{}_cmd", Q)}, ROBOT)
    assert 'q_des_joint_2 = "m2_cmd"' in drafted.text and not drafted.unused
    assert "no name states that these are positions: CHECK" in drafted.text
    assert "rated torque / 100: CHECK" in drafted.text
    both = draft_map({**named, **by_joint("m{}_cmd", V), **by_joint("m{}_pos_cmd", Q)}, ROBOT)
    assert both.unused == ("m1_cmd", "m2_cmd", "m3_cmd"), "columns with a word for positions come first"


@pytest.mark.parametrize("name", LOGS)
def test_a_complete_map_is_drafted_and_reads(name: str) -> None:
    log, texts = LOGS[name]
    drafted = draft_map(log, ROBOT)
    for text in texts:
        assert text in drafted.text, drafted.text
    assert not drafted.lacking and not drafted.unused and max(map(len, drafted.text.splitlines())) < 160
    columns: dict[str, Any] = tomllib.loads(drafted.text)
    assert len(columns["columns"]) + len(columns["clock"]) == len(log), "each column has a line"
    strong = signid.load_robot("3r", actuators=str(constants()))
    found = read_recording(log, strong, columns=columns).read()
    turn = np.pi / 2 if "degrees, slashes" in name else 1.0
    np.testing.assert_allclose(found.q, turn * Q, atol=1e-3)
    np.testing.assert_allclose(abs(found.tau), abs(TAU), atol=1e-3)
    np.testing.assert_allclose(found.t - found.t[0], T, atol=1e-6)
    if found.dq is not None:
        np.testing.assert_allclose(found.dq, V, rtol=1e-12)


def constants() -> Path:
    import tempfile

    path = Path(tempfile.gettempdir()) / "signid_draft_actuators.toml"
    path.write_text("".join(f"[joint.joint_{j}]\ntorque_constant = 1.0\n" for j in (1, 2, 3)))
    return path


def test_hostile_names_stay_inside_their_line() -> None:
    evil = 'x"\n[units]\nq = "rev'
    log = {"t": T, f"pos_1{evil}": Q[:, 0], evil: Q[:, 1], "tau_1": TAU[:, 0]}
    assert "units" in tomllib.loads(draft_map(log, ROBOT).text)
    assert tomllib.loads(draft_map(log, ROBOT).text)["units"].get("q") == "rad"


def test_one_command_is_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    header = ["stamp", *(f"Achse {j} Istposition" for j in (1, 2, 3)), *(f"Motor{j} trq" for j in (1, 2, 3))]
    rows = np.column_stack([np.rint(T * 1e6), np.degrees(Q), TAU]).tolist()
    lines = [";".join(header), *(";".join(f"{x:.6f}".replace(".", ",") for x in row) for row in rows)]
    Path("log.csv").write_text("\n".join(lines))
    line = "convert log.csv --robot 3r -o recording.csv"
    assert run(shlex.split(line)) == 0
    out, err = capfd.readouterr()
    assert err == "" and "Reading of log.csv" in out and "Achse 1 Istposition" in out
    assert pl.read_csv("recording.csv")["q_joint_1"].to_numpy() == pytest.approx(Q[:, 0], abs=1e-6)
    assert not Path("log.csv.reading.toml").exists(), "nothing is to be chosen"
    written = draft_map("log.csv", ROBOT).text
    Path("log.csv.reading.toml").write_text(written.replace('q = "deg"', 'q = "mrad"'))
    assert run(shlex.split(line)) == 0
    found = pl.read_csv("recording.csv")
    assert found["q_joint_1"].to_numpy() == pytest.approx(np.degrees(Q[:, 0]) / 1e3, abs=1e-6), "as the user corrected"
    assert "mrad" in Path("log.csv.reading.toml").read_text(), "a reading that exists is not written again"
    capfd.readouterr()
    assert run(shlex.split("convert log.csv --calibration log.csv")) == 2


def test_a_log_without_positions_is_flagged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("log.csv").write_text("t,mode,volts\n0,1,2\n1,2,3\n")
    assert run(shlex.split("convert log.csv --robot 3r --json")) == 3
    out, err = capfd.readouterr()
    assert "log.csv has no position column such as q_joint_1" in err and '"columns": [' in out
    assert "no column of positions or speeds was recognised" in draft_map("log.csv", ROBOT).text


def test_errors_name_the_line_to_write(capfd: pytest.CaptureFixture[str]) -> None:
    found = read_recording({"t": T, **by_joint("q_{}", Q), **by_joint("tau_abs_{}", abs(TAU))}, ROBOT)
    assert found.columns["tau"] == ("tau_abs_1", "tau_abs_2", "tau_abs_3") and not found.signed.any()
    with pytest.raises(RecordingError, match=r'did you mean q_elbow = "elbow_pos"\?'):
        read_recording({"t": T, "elbow_pos": T}, ROBOT, columns={"q_elbow": "elbow_pso"})
    with pytest.raises(RecordingError, match=r'\[units\] q = "deg"'):
        signid.identify(ROBOT, [read_recording({"t": T, **by_joint("q_{}", 60 * Q), **by_joint("tau_{}", TAU)}, ROBOT)])
    with pytest.raises(RecordingError, match=r'\[units\] t = "ms"'):
        signid.identify(
            ROBOT, [read_recording({"t": T * 1e4, **by_joint("q_{}", Q), **by_joint("tau_{}", TAU)}, ROBOT)]
        )
    write_error("x" * 3000 + " is no robot; give another")
    shown = capfd.readouterr().err
    assert len(shown) < 400 and shown.endswith("is no robot; give another\n")
