"""Numbers of drives that no drive has end in one sentence and exit code 2, in actuators files and in model.json."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest
from servo_loops import driven

from signid.cli import run
from signid.errors import SignidError
from signid.model import load_model
from signid.output.export import KINDS, VENDORS, export
from signid.robot import load_robot
from signid.servos import DRIVE_LAWS, KD_ON, LIMIT_KEYS, SERVO_NUMBERS, Servo

WRONG = {
    "kp": ("5e-324", "1e-10", "1e11", "-1", "1e300"),
    "kd": ("-1e-300", "1e11"),
    "delay": ("11", "-0.01", "1e300"),
    "effort_limit": ("1e-320", "1e99"),
    "armature": ("1e8",),
    "kp_register": ("5e-324", "1e30"),
}
CASES = [(name, value) for name, values in WRONG.items() for value in values]


@pytest.mark.parametrize(("name", "value"), CASES)
def test_numbers_of_no_drive_are_refused(name: str, value: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(f"[joint.joint_1.servo]\n{name} = {float(value)!r}\n")
    with pytest.raises(SignidError, match=f"{name} = .*expected .* to "):
        load_robot("1r", actuators=tmp_path / "a.toml")
    document = driven("1r", {"joint_1": Servo(kp=10.0)}).document()
    document["servos"]["joint_1"][name] = float(value)
    (tmp_path / "model.json").write_text(json.dumps(document))
    with pytest.raises(SignidError, match=name):
        load_model(tmp_path / "model.json")


@pytest.mark.parametrize("value", ["5e-324", "1e11"])
def test_commands_end_with_2(value: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.toml").write_text(f"[joint.joint_1.servo]\nkp = {value}\n")
    t = [k / 100 for k in range(300)]
    pl.DataFrame({"t": t, "q_1": t, "q_des_1": t}).write_csv(tmp_path / "log.csv")
    for verb in ("validate", "diagnose", "identify"):
        words = [verb, "1r", str(tmp_path / "log.csv"), "--actuators", str(tmp_path / "a.toml"), "--json"]
        assert run(words) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1 and "expected a positive number from 1e-09 to 1e+07" in said


def test_the_extremes_and_zeros_of_saved_drives_are_read_again(tmp_path: Path) -> None:
    servo = Servo(kp=1e7, kd=0.0, delay=1e-15, effort_limit=1e-9, coulomb_friction=1e-14, kp_register=1e7)
    (tmp_path / "model.json").write_text(json.dumps(driven("1r", {"joint_1": servo}).document()))
    assert load_model(tmp_path / "model.json").servos["joint_1"] == servo


@pytest.mark.slow
@pytest.mark.parametrize("law", DRIVE_LAWS)
def test_drives_that_are_read_can_be_exported(law: str, tmp_path: Path) -> None:
    whole = driven("1r", {"joint_1": Servo(kp=10.0, kd=1.0, effort_limit=5.0, speed_limit=4.0)}).document()
    for name in SERVO_NUMBERS:
        for value in (0.0, 5e-324, 1e-9, 1e7):
            for kd_on in KD_ON:
                numbers = {**whole["servos"]["joint_1"], "law": law, "kd_on": kd_on, name: value}
                (tmp_path / "m.json").write_text(json.dumps({**whole, "servos": {"joint_1": numbers}}))
                try:
                    model = load_model(tmp_path / "m.json")
                except SignidError:
                    continue
                for kind in sorted({*KINDS} - {*VENDORS}):  # those write payloads alone
                    export(model, kind)


@pytest.mark.parametrize("known", ["kp=1e300", "kp=1e30", "kp=1e8", "kp.joint_1=1e8", "kp=0", "kp=nan", "kp=x", "kp="])
def test_stated_gains_have_the_same_bounds(known: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = [k / 100 for k in range(300)]
    pl.DataFrame({"t": t, "q_1": t, "q_des_1": t}).write_csv(tmp_path / "log.csv")
    assert run(["identify", "1r", str(tmp_path / "log.csv"), "--json", "--known", known]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "kp=20" in said and known in said


def test_a_model_that_could_not_be_read_is_not_written(tmp_path: Path) -> None:
    model = driven("1r", {"joint_1": Servo(kp=10.0)})
    for wrong in (replace(model, inertials=1e13 * model.inertials), driven("1r", {"joint_1": Servo(kp=1e30)})):
        with pytest.raises(SignidError, match="the model of 1r has a number that no robot has .*stated gains"):
            wrong.save(tmp_path / "model.json")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        *((name, value, f"servos.joint_1.{name}: ") for name in LIMIT_KEYS for value in (0, 1e-300)),
        ("law", "magic", "magic"),
        ("kp", "stiff", "kp"),
        ("kp", float("nan"), "kp"),
        ("effort_limit", float("inf"), "effort_limit"),
        ("kp_register", 0, "kp_register"),
        ("colour", 1, "colour"),
    ],
)
def test_wrong_entries_of_a_saved_drive_are_refused(
    place: str, value: object, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = driven("1r", {"joint_1": Servo(law="torque_speed", kp=10.0, effort_limit=5.0)}).document()
    document["servos"]["joint_1"][place] = value
    (tmp_path / "model.json").write_text(json.dumps(document))
    assert run(["export", str(tmp_path / "model.json"), "--mjcf", str(tmp_path / "x.xml")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and words in said
