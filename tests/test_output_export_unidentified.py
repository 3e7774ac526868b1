"""Numbers of drives that recordings do not identify are never exported as if they did."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import signid
from signid.cli import run
from signid.errors import OptionError
from signid.model import Model, load_model, with_servos
from signid.servo.identify import ServoOptions, identify_servos
from signid.servo.simulate import simulate_servos
from signid.servos import Servo
from signid.types import Trajectory

ESTIMATE, FRICTION = 5.7123, 3.5e-18  # as a fit leaves them
KINDS = ("mjcf", "actuators", "ros", "isaaclab", "mjlab", "lerobot", "expected", "c", "arrays", "function", "urdf")


def driven(kp: float | None) -> Model:
    """A drive of joint_2 whose gain and friction are not identifiable; the gain was stated as `kp`, or not at all."""
    unknown = {"kp": kp, "coulomb_friction": None, "armature": 0.03}
    servo = Servo(kp=ESTIMATE, kd=0.5, coulomb_friction=FRICTION, armature=0.7111, not_identifiable=unknown)
    return with_servos(load_model("3r"), {"joint_2": servo})


@pytest.mark.parametrize("kind", KINDS)
def test_the_stated_value_is_written_and_said(kind: str) -> None:
    made = signid.export(driven(20.0), kind)
    text = made.text + "".join(made.beside.values())
    assert "5.7123" not in text and "0.7111" not in text and "3.5e-18" not in text
    of_torque = kind in ("c", "arrays", "function", "urdf")
    said = "stated before the recordings: " + ("armature" if of_torque else "kp, armature") + " of joint_2"
    assert any(said in note for note in made.notes) and said in made.text
    assert any("left out: coulomb_friction of joint_2" in note for note in made.notes)
    assert of_torque or re.search(r"\b20(\.0)?\b", made.text)


@pytest.mark.parametrize("kind", ["mjcf", "actuators", "isaaclab", "lerobot"])
def test_a_gain_without_a_stated_value_is_refused(kind: str) -> None:
    with pytest.raises(OptionError, match=r"kp of joint_2 is not identifiable.*--known kp\.joint_2=20"):
        signid.export(driven(None), kind)


def test_files_remain_readable() -> None:
    import mujoco

    mujoco.MjModel.from_xml_string(signid.export(driven(20.0), "mjcf").text)
    compile(signid.export(driven(20.0), "isaaclab").text, "file", "exec")
    assert json.loads(signid.export(driven(20.0), "lerobot").text)["notes"]
    assert signid.export(driven(20.0), "urdf").text.startswith(("<?xml", "<robot", "<!--"))


def test_a_saved_model_still_knows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = driven(None).save(tmp_path / "model.json")
    assert load_model(path).servos["joint_2"].not_identifiable == driven(None).servos["joint_2"].not_identifiable
    assert run(["export", str(path), "--mjcf", str(tmp_path / "x.xml")]) == 2
    assert "kp of joint_2 is not identifiable" in capsys.readouterr().err
    assert not (tmp_path / "x.xml").exists()


def test_an_identification_marks_what_it_does_not_identify() -> None:
    """The axis of joint_1 is vertical and its load acts like its armature, so the scale of its drive is unknown."""
    model, t = load_model("3r"), np.arange(0, 6, 0.01)
    q = np.column_stack([0.4 * np.sin(2 * t) + 0.2 * np.sin(5 * t), 0 * t, 0 * t])
    motion = Trajectory(model.robot.joints, t, q, np.gradient(q, t, axis=0), 0 * q)
    truth = Servo(kp=60.0, kd=3.0, delay=0.01, armature=0.1)
    done = simulate_servos(with_servos(model, {"joint_1": truth}), motion)
    robot = signid.load_robot("3r", lock={"joint_2": 0.0, "joint_3": 0.0})
    columns = {key: x for key, x in done.columns.items() if key == "t" or key.endswith("_joint_1")}
    found = identify_servos(robot, [signid.read_recording(columns, robot)], options=ServoOptions())
    lost = {name for name, number in found.joints[0].numbers.items() if number.value is None}
    marked = found.model.servos["joint_1"].not_identifiable
    assert "kp" in lost and set(marked) == lost - {"damping", "lag", "effort_limit"} | ({"effort_limit"} & set(marked))
