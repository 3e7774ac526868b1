"""Numbers of drives that no drive has end in one sentence and exit code 2, in actuators files and in model.json."""

from __future__ import annotations

import json
from pathlib import Path

import polars as pl
import pytest
from servo_loops import driven

from signid.cli import run
from signid.errors import SignidError
from signid.model import load_model
from signid.robot import load_robot
from signid.servos import Servo

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
