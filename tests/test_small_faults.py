"""Small faults of inputs end with one sentence."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import signid
from signid.cli.run import run
from signid.errors import OptionError, RecordingError
from signid.recording import read_recording
from signid.recording.convert import convert
from signid.servo.given import given_texts


def test_a_bad_number_of_a_joint_is_not_left_out(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    rows = [f"{0.01 * k},{k % 7},{k % 5},{k % 3},run,go" for k in range(50)]
    rows[20] = "0.2,1,1.2e,2,run,go"
    (tmp_path / "a.csv").write_text("\n".join(["t,q_arm,tau_arm,q_2,q_mode,state", *rows, ""]))
    assert run(["convert", str(tmp_path / "a.csv"), "-o", str(tmp_path / "b.csv")]) == 2
    assert "'1.2e' in row 21" in capfd.readouterr().err and not (tmp_path / "b.csv").exists()
    (tmp_path / "a.csv").write_text((tmp_path / "a.csv").read_text().replace("1.2e", "1.2"))
    found = convert(tmp_path / "a.csv")
    assert set(found.columns) == {"t", "q_arm", "tau_arm", "q_2"} and "q_mode" in found.notes[-1]


def test_masked_values_are_missing() -> None:
    t = np.arange(0, 5, 0.01)
    given = {"t": t, "q_1": np.sin(t), "tau_1": np.ma.masked_greater(np.where(t < 4, t, 999.0), 900.0)}
    tau = read_recording(given, signid.load_robot("1r")).read().tau
    assert tau is not None and np.isnan(tau[:, 0]).sum() == 100


def test_thousands_of_names_and_laws_are_refused_at_once(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.csv").write_text("0,1\n1,2\n")
    names = ",".join(f"c{k}" for k in range(15_000))
    assert run(["convert", str(tmp_path / "a.csv"), "--names", names]) == 2
    with pytest.raises(RecordingError, match="30000 names"):
        read_recording(tmp_path / "a.csv", signid.load_robot("1r"), columns={"names": [f"c{k}" for k in range(30_000)]})
    saved = signid.load_model("3r").save(tmp_path / "model.json")
    content = json.loads(Path(saved).read_text())
    content["effects"] = [{"effect": "torque_offset", "joint": "joint_1", "parameters": {"offset": 1.0}}] * 100_000
    Path(saved).write_text(json.dumps(content))
    assert run(["export", str(saved), "--urdf", str(tmp_path / "a.urdf")]) == 2
    assert "more than 2000" in capfd.readouterr().err


def test_a_model_is_no_description_and_a_manifest_lists_three_rows(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    saved = signid.load_model("3r").save(tmp_path / "model.json")
    assert run(["inspect", str(saved)]) == 2
    assert "take a model.json" in capfd.readouterr().err
    (tmp_path / "all.csv").write_text("robot,recording\n" + "3r,\n" * 1000)
    assert run(["fleet", str(tmp_path / "all.csv"), "-o", str(tmp_path / "out")]) == 2
    err = capfd.readouterr().err
    assert err.count("\n") == 4 and "and 997 more" in err


@pytest.mark.parametrize(
    "given", [{"known": [""]}, {"known": ["kp=1", "kp=2"]}, {"prior": ["kp=1+-1e-300"]}, {"bounds": ["kp=1..2"] * 2}]
)
def test_texts_of_drives_are_not_ignored(given: dict[str, list[str]]) -> None:
    robot = signid.load_robot("3r")
    with pytest.raises(OptionError, match="give"):
        given_texts(robot, robot.joints, {}, **given)  # type: ignore[arg-type]


def test_a_start_without_commands_is_one_sentence() -> None:
    from signid.output.export.loop import loop_of

    recording = read_recording("robots/3r/recording.parquet", "3r")
    with pytest.raises(RecordingError, match="no q_des_J"):
        loop_of(signid.load_model("3r"), recording)
