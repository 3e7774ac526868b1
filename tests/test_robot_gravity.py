"""Gravity as stated: in the frame of the root link, in every command, in model.json and in factors."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.main import get_command

import signid
from signid.cli import run
from signid.cli.app import app
from signid.errors import OptionError, RobotError
from signid.model import stated_inertials
from signid.robot.dynamics import rigid_torque
from signid.types import Array, Robot

WITHOUT = {"demo", "fleet", "effects", "data"}  # fleet: a column of the manifest
WALL = (0.0, -9.81, 0.0)
BAD = ("0,0", "0,0,x", "0,0,nan", "0,0,1e9", "", "0;0;-9.81")


def _torque(robot: Robot, q: list[float]) -> Array:
    at = np.array([q])
    return rigid_torque(robot, at, 0 * at, 0 * at)[0]


def test_the_torque_of_a_robot_on_a_wall_is_that_of_a_description_turned_by_90_degrees(tmp_path: Path) -> None:
    """The fixed joint turns the arm about x by 90 degrees, so its root sees gravity along -z and its base along -y."""
    plain = signid.load_robot("3r")
    turned = plain.document.replace(
        '<link name="base_link"/>',
        '<link name="wall"/><link name="base_link"/><joint name="mount" type="fixed"><parent link="wall"/>'
        '<child link="base_link"/><origin rpy="1.5707963267948966 0 0"/></joint>',
    )
    (tmp_path / "wall.urdf").write_text(turned)
    q = [0.4, -1.1, 0.7]
    mounted = signid.load_robot("3r", gravity=WALL)
    assert _torque(mounted, q) == pytest.approx(_torque(signid.load_robot(tmp_path / "wall.urdf"), q), abs=1e-12)
    assert abs(_torque(mounted, q)[0]) > 1 > 1e-9 > abs(_torque(plain, q)[0]), "joint 1 stands upright on the floor"
    assert mounted.notes[-1] == "gravity is (0, -9.81, 0) m/s2 in the frame of base_link"
    assert not np.any(_torque(signid.load_robot("3r", gravity=(0, 0, 0)), q))


@pytest.mark.parametrize("wrong", [(0, 0), "0,0,-9.81", (0, 0, np.inf), ("a", 0, 0), 9.81])
def test_gravity_in_python_is_three_numbers(wrong: object) -> None:
    with pytest.raises(OptionError, match="gravity is"):
        signid.load_robot("3r", gravity=wrong)  # type: ignore[arg-type]


def test_a_model_keeps_its_gravity_and_older_files_load(tmp_path: Path) -> None:
    model = signid.load_model("3r", gravity=WALL)
    saved = model.save(tmp_path / "model.json")
    assert json.loads(saved.read_text())["gravity"] == list(WALL)
    assert signid.load_model(saved).robot.model.gravity.linear.tolist() == list(WALL)
    assert signid.load_model(saved, gravity=(0, 0, 9.81)).robot.model.gravity.linear.tolist() == [0, 0, 9.81]
    document = json.loads(saved.read_text())
    del document["gravity"]
    saved.write_text(json.dumps(document))
    assert signid.load_model(saved).robot.model.gravity.linear.tolist() == [0, 0, -9.81]
    saved.write_text(json.dumps({**document, "gravity": [0, 0]}))
    with pytest.raises(RobotError, match="model.json: gravity is"):
        signid.load_model(saved)


def test_an_exported_urdf_and_function_say_which_gravity_they_need() -> None:
    model = signid.load_model("3r", gravity=WALL)
    assert "the gravity of the model is 0.0 -9.81 0.0 m/s2" in signid.export(model, "urdf").text
    assert "GRAVITY = (0.0, -9.81, 0.0)" in signid.export(model, "function").text
    assert 'gravity="0.0 -9.81 0.0"' in signid.export(model, "mjcf").text
    assert "GRAVITY" not in signid.export(signid.load_model("3r"), "function").text
    assert np.array_equal(stated_inertials(model.robot), stated_inertials(signid.load_robot("3r")))


@pytest.mark.parametrize("wrong", BAD)
def test_bad_gravity_is_one_sentence_and_exit_code_2(wrong: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["inspect", "3r", "--gravity", wrong]) == 2
    said = capsys.readouterr().err
    assert f"--gravity {wrong!r} is not a vector" in said and said.count("\n") == 1


def test_inspection_without_gravity_knows_fewer_parameters(capsys: pytest.CaptureFixture[str]) -> None:
    """First moments show in the weight of links, and without it only in the torque of joints that accelerate them."""
    counts = []
    for more in ([], ["--gravity=-9.81,0,0"], ["--gravity", "0,0,0"]):
        assert run(["inspect", "3r", "--json", *more]) == 0
        counts.append(len(json.loads(capsys.readouterr().out)["base_parameters"]))
    assert counts[1] > counts[0] > counts[2], "on its side, joint 1 shows the first moment of its own link"


def test_every_command_that_takes_a_robot_takes_gravity() -> None:
    for name, command in get_command(app).commands.items():  # type: ignore[attr-defined]
        options = {text for parameter in command.params for text in parameter.opts}
        assert ("--gravity" in options) == (name not in WITHOUT), name
