"""The command `signid export`: files, notes and bad input."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import pytest
from exported import model_of

from signid.cli import run
from signid.output.report import to_json

KINDS = {
    "urdf": "robot.urdf",
    "mjcf": "robot.xml",
    "actuators": "actuators.toml",
    "function": "laws.py",
    "ros": "r.yaml",
    "isaaclab": "i.py",
}


@pytest.fixture
def saved(tmp_path: Path) -> str:
    model = model_of("3r", "payload:mass=0.3", "viscous_friction@1", "torque_offset@2", "time_delay")
    (tmp_path / "model.json").write_text(to_json(model.document()))
    return str(tmp_path / "model.json")


def options(folder: Path) -> list[str]:
    return [part for kind, name in KINDS.items() for part in (f"--{kind}", str(folder / name))]


def test_all_files_at_once(saved: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["export", saved, *options(tmp_path / "out")]) == 3
    said = capsys.readouterr()
    printed = " ".join(said.out.split())
    late = "time_delay (torque recorded 4.0 ms late), an error of the recording, not of the robot"
    for line in (
        "urdf: a URDF cannot hold torque_offset of joint_2, held by actuators, ros, function",
        f"mjcf: an MJCF cannot hold {late}",
        "actuators: an actuators file cannot hold payload of joint_3, held by urdf",
        "function: this file cannot hold payload of joint_3, held by urdf, mjcf",
        f"function: this file cannot hold {late}",
    ):
        assert line in printed
    flag = (
        "signid: isaaclab: an actuator group of Isaac Lab cannot hold torque_offset of joint_2: 21 % of the torque of "
    )
    assert said.err.startswith(flag) and said.err.count("\n") == 1
    assert "along a simulated motion; held by mjcf, actuators, function, ros, newton, c, arrays" in said.err
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(KINDS.values())
    mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "robot.xml"))
    first = {name: (tmp_path / "out" / name).read_bytes() for name in KINDS.values()}
    assert run(["export", str(saved), *options(tmp_path / "again")]) == 3
    assert first == {name: (tmp_path / "again" / name).read_bytes() for name in KINDS.values()}


def test_json_says_the_same(saved: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["export", saved, "--json", "--mjcf", str(tmp_path / "robot.xml")]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["schema"], document["robot"], document["inputs"][0]["path"]) == ("signid.export/1", "3r", saved)
    assert [(file["kind"], file["path"]) for file in document["files"]] == [("mjcf", str(tmp_path / "robot.xml"))]
    assert document["files"][0]["flags"] == []
    assert document["files"][0]["notes"][0].startswith("an MJCF cannot hold time_delay")


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (["3r"], "no file was named; add --urdf, --mjcf, --actuators, --function, --ros, --isaaclab, --mjlab"),
        (["3r", "--urdf", ""], "--urdf '' is not a file name"),
        (["3r", "--mjcf", "."], "--mjcf '.' is not a file name"),
        (["3r", "--urdf", "a", "--mjcf", "./a"], "two of the files have the same name"),
        (["3r", "--function", "a_file/laws.py"], "name a folder with --function"),
        (["a_file", "--urdf", "out"], "a_file"),
        (["none.json", "--urdf", "out"], "cannot read none.json"),
        (["a.xml", "--mjcf", "b.xml", "--urdf", "out"], "export to URDF needs a URDF"),
        (["nobody", "--urdf", "out"], "no file and no robot named 'nobody'"),
    ],
)
def test_bad_input_gives_one_sentence_and_no_files(
    given: list[str], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a_file").write_text("x")
    body = '<body><joint/><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/></body>'
    Path("a.xml").write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    before = sorted(tmp_path.iterdir())
    assert run(["export", *given]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1 and sentence in printed.err
    assert sorted(tmp_path.iterdir()) == before
