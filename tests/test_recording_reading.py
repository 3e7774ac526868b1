"""One reading of a log: drafted by the first command, printed, written where a line is to be chosen, and found."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from test_recording_draft import ROBOT, TAU, Q, T, by_joint
from test_signs_gains import CONSTANTS, PENDULUM, heavier, joint, link, made, stating, toy

import signid
from signid.cli import run
from signid.errors import RecordingError, UndecidedReading
from signid.output.report import document

DEGREES = np.degrees(Q)


def write(name: str, time: str, position: str, torque: str, scale: float = 1.0) -> None:
    """A log with stamps since 1970 in ms, some of them missing values, below names of columns with a place for J."""
    columns = {time: np.rint(1.7e12 + 1e3 * T), **by_joint(position, DEGREES), **by_joint(torque, scale * TAU)}
    columns[torque.format(2)][[20, 200, 300]] = np.nan
    pl.DataFrame(columns).fill_nan(None).write_csv(name, separator=";")


@pytest.mark.parametrize(
    ("time", "position", "torque"),
    [
        ("Zeit_ms", "Winkel_Achse{}_Grad", "Drehmoment_Achse{}_Nm"),
        ("time_ms", "J{}_angle_deg", "J{}_torque_Nm"),
        ("temps_ms", "position_axe{}_degres", "couple_axe{}_Nm"),
        ("tiempo_ms", "posicion_eje{}_grados", "par_eje{}_Nm"),
        ("tempo_ms", "posizione_giunto{}_gradi", "coppia_giunto{}_Nm"),
    ],
)
def test_the_first_command_reads_a_log(
    time: str, position: str, torque: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write("log.csv", time, position, torque)
    found = signid.read_recording("log.csv", ROBOT)
    assert found.joints == ROBOT.joints and found.reading is not None and found.reading.rows[0][:2] == ("time", time)
    assert {unit.by for unit in found.units.values()} == {"the reading"}
    samples = found.read()
    np.testing.assert_allclose(samples.q, Q, atol=1e-9)
    np.testing.assert_allclose(samples.tau, TAU, atol=0.05)  # values that are missing are bridged
    assert not Path("log.csv.reading.toml").exists(), "nothing is to be chosen"


def test_the_reading_is_printed_and_goes_into_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write("log.csv", "Zeit_ms", "Winkel_Achse{}_Grad", "Drehmoment_Achse{}_Nm")
    assert run(["check", "3r", "log.csv", "-o", "r"]) in (0, 3)
    out = capfd.readouterr().out
    assert out.startswith("Reading of log.csv") and "Winkel_Achse2_Grad" in out.split("3r:")[0]
    assert run(["check", "3r", "log.csv", "--json"]) in (0, 3)
    assert json.loads(capfd.readouterr().out)["schema"] == "signid.check/1"


def test_lines_to_choose_are_written_once_and_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write("log.csv", "Zeit_ms", "Winkel_{}_Grad", "Drehmoment_{}_Nm")
    names = {f"{kind}_{j}_{unit}": f"{kind}_{word}_{unit}" for j, word in ((1, "Fuss"), (2, "Knie"), (3, "Kopf"))
             for kind, unit in (("Winkel", "Grad"), ("Drehmoment", "Nm"))}  # fmt: skip
    pl.read_csv("log.csv", separator=";").rename(names).write_csv("log.csv")
    assert run(["identify", "3r", "log.csv", "-o", "r"]) == 3
    said = capfd.readouterr().err
    file = Path("log.csv.reading.toml")
    assert said.count("\n") == 1 and "Winkel_Fuss_Grad for q_joint_1" in said and str(file) in said
    drafted = file.read_text()
    for verb in ("identify", "check"):  # nothing was chosen
        assert run([verb, "3r", "log.csv", "-o", "r"]) == 3
        said = capfd.readouterr().err
        assert str(file) in said and '"Winkel_Fuss_Grad"' in said and file.read_text() == drafted
    chosen = drafted.replace("# q_", "q_").replace("# tau_", "tau_")
    file.write_text(chosen)
    found = signid.read_recording("log.csv", ROBOT)
    assert found.joints == ROBOT.joints and found.reading is not None and found.reading.path == str(file)
    np.testing.assert_allclose(found.read().q, Q, atol=1e-9)
    run(["check", "3r", "log.csv"])
    assert file.read_text() == chosen
    with pytest.raises(UndecidedReading, match="which"):
        file.unlink()
        signid.read_recording("log.csv", ROBOT)


def test_sections_of_a_reading(tmp_path: Path) -> None:
    columns = {"t": T, **by_joint("q_{}", Q), **by_joint("current_{}", TAU)}
    columns["current_1"] = np.where(np.arange(len(T)) == 7, -999.0, columns["current_1"])
    file = tmp_path / "log.csv.reading.toml"
    file.write_text(
        '[clock]\ntime = "t"\n[missing]\nvalues = [-999]\n[torque_constant]\njoint_1 = 2\njoint_2 = 3\njoint_3 = 4.0\n'
    )
    pl.DataFrame(columns).write_csv(tmp_path / "log.csv")
    found = signid.read_recording(tmp_path / "log.csv", ROBOT)
    np.testing.assert_allclose(found.read().tau, TAU * [2, 3, 4], atol=0.1)
    for text, culprit in (
        ("[torque_constant]\nelbow = 2", "elbow"),
        ("[torque_constant]\njoint_1 = 0", "joint_1"),
        ("[gravity]\nvector = [1, 2]", "gravity"),
        ("[clock]\nzone = 1", "time or rate"),
        ('[missing]\nvalues = "-"', "-999"),
    ):
        file.write_text(text)
        with pytest.raises(RecordingError, match=culprit):
            signid.read_recording(tmp_path / "log.csv", ROBOT)


LEROBOT = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
SO100 = ("Rotation", "Pitch", "Elbow", "Wrist_Pitch", "Wrist_Roll", "Jaw")


@pytest.mark.parametrize(("own", "recorded"), [("123456", LEROBOT), (SO100, LEROBOT), (LEROBOT, SO100)])
def test_joints_of_so_arms_are_matched_by_their_place(
    own: tuple[str, ...], recorded: tuple[str, ...], tmp_path: Path
) -> None:
    text = (Path(signid.load_robot("so101").path)).read_text()
    for name, other in zip(LEROBOT, own, strict=True):
        text = text.replace(f'"{name}"', f'"{other}"')
    (tmp_path / "arm.urdf").write_text(text)
    columns = {"timestamp": T}
    for k, name in enumerate(recorded):
        columns[f"observation.state.{name}.pos"] = np.degrees(0.2 + 0.1 * np.sin((k + 1) * T))
        columns[f"action.{name}.pos"] = columns[f"observation.state.{name}.pos"] + 3 * np.cos(T)
    pl.DataFrame(columns).write_csv(tmp_path / "log.csv")
    found = signid.read_recording(tmp_path / "log.csv", tmp_path / "arm.urdf")
    used = dict(zip(found.joints, found.columns["q"], strict=True))
    assert used == {joint: f"observation.state.{name}.pos" for joint, name in zip(own, recorded, strict=True)}
    rows = found.reading.rows[1:] if found.reading else ()
    assert len(rows) == 6 and all("joint by its place in the arm" in row[3] for row in rows)


def test_a_commanded_torque_is_said() -> None:
    desired = Q + 0.02 * np.cos(7 * T)[:, None]
    v = np.gradient(Q, T, axis=0)
    tau = 120 * (desired - Q) - 4 * v
    tau[:, 1] += np.sin(9 * T)
    log = {"t": T, **by_joint("q_{}", Q), **by_joint("q_des_{}", desired), **by_joint("tau_{}", tau)}
    said = [note for note in signid.read_recording(log, ROBOT).notes if "command" in note]
    assert len(said) == 2 and "torque of joint_1 is a command" in said[0] and "120 (q_des - q) - 4 dq" in said[0]


def test_a_current_without_a_constant_stays_in_amperes() -> None:
    robot = toy(link("a"), link("b", PENDULUM), link("c", PENDULUM), joint("y", "a", "b"), joint("z", "a", "c"))
    columns = made(robot, 2)
    currents = {f"current_{j + 1}": columns.pop(f"tau_{j + 1}") / CONSTANTS[j] for j in range(2)}
    robot = stating(heavier(robot, 0.0), (0,))
    found = signid.identify(robot, signid.read_recording({**columns, **currents}, robot))
    laws = {(law["effect"], law["joint"]): law["parameters"] for law in document(found)["effects"]}
    here, there = laws["viscous_friction", "y"]["coefficient"], laws["viscous_friction", "z"]["coefficient"]
    assert there["unit"] == "A.s/rad" and abs(CONSTANTS[1] * there["value"] / here["value"] - 1) < 0.1
    assert found.fit.unit == ("N.m", "A") and found.fit.held_out_r2.min() > 0.99
    assert any("residual of z are in A" in flag for flag in found.flags)


def test_a_current_without_a_constant_is_left_out_of_a_comparison() -> None:
    robot = toy(link("a"), link("b", PENDULUM), link("c", PENDULUM), joint("y", "a", "b"), joint("z", "a", "c"))
    columns = made(robot, 2)
    columns["current_2"] = columns.pop("tau_2") / CONSTANTS[1]
    robot = stating(heavier(robot, 0.0), (0,))
    recording = signid.read_recording(columns, robot)
    for verb in (signid.validate, signid.diagnose):
        found = verb(signid.load_model(robot), recording)
        [flag] = [flag for flag in found.flags if "torque constant of z is not known" in flag]
        assert "the current of z is left out of the comparison" in flag
        rest = found.held_out.before if verb is signid.diagnose else found.models[0].residual
        assert np.isfinite(rest[:, 0]).any() and not np.isfinite(rest[:, 1]).any()
