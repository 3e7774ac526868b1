"""`signid data` for position drives: their logs become recordings, and the command that it prints names real files."""

from __future__ import annotations

import json
import shlex
import tomllib
from pathlib import Path

import pytest
from public import layout
from serving import TEXT, register, toy

import signid
from signid.cli import run
from signid.recording.gallery import DATA, bam, is_complete

PATH = "logs/a_toy.csv"
ROBOTS = Path(__file__).parents[1] / "robots"
DRIVES = [one.name for one in DATA if one.drives]
ENTRY = {"speed": -0.25, "input_volts": 7.4, "temp": 29, "timestamp": 0.0035711526870727, "goal_position": 0.1}


def test_a_log_of_bam() -> None:
    entries = [
        {**ENTRY, "position": -0.01380582709097, "load": 3, "torque_enable": True},
        {**ENTRY, "position": 0, "load": 65533, "torque_enable": False},
    ]
    header, first, last = bam(json.dumps({"kp": 400, "entries": entries}).encode()).splitlines()
    assert header == "t,q_servo,q_des_servo,dq_servo,pwm_servo,volt_servo,temp_servo,on_servo"
    assert first == "0.0035711527,-0.013805827,0.1,-0.25,0.0033898305,7.4,29,1"  # pwm 3 / 885
    assert last == "0.0035711527,0,0.1,-0.25,-0.0033898305,7.4,29,0"


def test_position_drives_have_a_heading_of_their_own(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["data"]) == 0
    first, second = capsys.readouterr().out.split("Position drives: commands and positions")
    names = [line.split()[0] for line in second.split("\n\n")[0].splitlines()[2:] if not line.startswith(" ")]
    assert names == DRIVES == ["bam_xl330", "bam_sts3250"]
    assert first.startswith("Torques or motor currents") and not any(name in first for name in DRIVES)
    assert run(["data", "--json"]) == 0
    assert [one["name"] for one in json.loads(capsys.readouterr().out)["sets"] if one["drives"]] == DRIVES


@pytest.mark.parametrize("name", DRIVES)
def test_the_printed_command_names_files_that_are_there(
    name: str, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for path, content in layout(data, DATA[name]).items():
        (tmp_path / "mirror" / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "mirror" / path).write_bytes(content)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SIGNID_DATA", "data")
    assert run(["data", name, "--yes", "--source", "mirror"]) == 0
    assert is_complete(DATA[name], Path("data", DATA[name].folder))
    words = shlex.split(capsys.readouterr().out.splitlines()[-1])
    assert words[:3] == ["signid", "identify", name] and "--held-out" in words
    assert all(Path(word).is_file() for word in words if "/" in word)
    stated = words[words.index("--actuators") + 1] if "--actuators" in words else None
    robot = signid.load_robot(name, actuators=stated)
    recordings = [signid.read_recording(word, robot) for word in words if word.endswith(".gz")]
    assert robot.joints == ("servo",) and len(recordings) > 2


def test_registers_are_stated_for_recordings_of_the_set() -> None:
    stated = tomllib.loads((ROBOTS / "bam_xl330" / "actuators.toml").read_text())["recording"]
    slow = {product.name for product in DATA["bam_xl330"].products if product.name.startswith("kp100_")}
    assert set(stated) == slow and {one["servo"]["kp_register"] for one in stated.values()} == {100}


def test_a_folder_as_source(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    register(toy(), monkeypatch)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SIGNID_DATA", "data")
    (tmp_path / "empty").mkdir()
    assert run(["data", "toy", "--yes", "--source", "empty"]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and "No such file" in err and not Path("data").exists()
    file = tmp_path / "mirror" / PATH
    file.parent.mkdir(parents=True)
    file.write_bytes(TEXT)
    assert run(["data", "toy", "--yes", "--source", "mirror/"]) == 0
    assert is_complete(toy(), Path("data/toy_there"))
