"""Numbers of drives that recordings do not identify are never exported as if they did."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from exported import executed

import signid
from signid.cli import run
from signid.errors import OptionError, RobotError
from signid.model import Model, load_model, with_servos
from signid.robot import robot_from_text
from signid.servo.identify import ServoOptions, identify_servos
from signid.servo.simulate import simulate_servos
from signid.servos import Servo
from signid.types import Trajectory

ESTIMATE, FRICTION = 5.7123, 3.5e-18  # as a fit leaves them
KINDS = ("mjcf", "actuators", "ros", "isaaclab", "mjlab", "c", "arrays", "function", "urdf")


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


@pytest.mark.parametrize("kind", ["mjcf", "actuators", "isaaclab"])
def test_a_gain_without_a_stated_value_is_refused(kind: str) -> None:
    with pytest.raises(OptionError, match=r"kp of joint_2 is not identifiable.*--known kp\.joint_2=20"):
        signid.export(driven(None), kind)


def test_files_remain_readable() -> None:
    import mujoco

    mujoco.MjModel.from_xml_string(signid.export(driven(20.0), "mjcf").text)
    compile(signid.export(driven(20.0), "isaaclab").text, "file", "exec")
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
    own = {x for x in lost if "/" not in x} - {"damping", "lag"}
    assert {"kp", "kd", "effort_limit"} <= lost and set(marked) == own
    assert not any(x is not None for x in marked.values()), "nothing was stated"
    with pytest.raises(OptionError, match=r"kp of joint_1 is not identifiable"):
        signid.export(found, "mjcf")


def test_what_is_left_out_is_no_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    unknown = dict.fromkeys(("delay", "coulomb_friction", "armature", "effort_limit"))
    model = with_servos(load_model("3r"), {"joint_2": Servo(kp=20.0, kd=0.5, not_identifiable=unknown)})
    drive = tomllib.loads(signid.export(model, "actuators").text)["joint"]["joint_2"]
    assert drive == {"servo": {"law": "effort", "kp": 20.0, "kd": 0.5}}
    node = yaml.safe_load(signid.export(model, "ros").text)["/**"]["ros__parameters"]["dynamics"]
    assert not set(unknown) & set(node["servo"]["joint_2"]) and node["joint"]["joint_2"] == {"effort_limit": 20.0}
    group = executed(signid.export(model, "isaaclab").text, "isaaclab.actuators", monkeypatch)["ACTUATORS"]["joint_2"]
    assert group.stiffness == 20.0 and not {"armature", "friction", "min_delay", "effort_limit"} & set(vars(group))
    motors = executed(signid.export(model, "mjlab").text, "mjlab.actuator", monkeypatch)["ACTUATORS"]
    assert motors[1].damping == 0.5 and not {"armature", "frictionloss", "delay_max_lag"} & set(vars(motors[1]))


def test_a_stated_value_is_said_where_it_stands() -> None:
    assert "kp = 20.0  # N.m/rad; not identifiable, as stated before" in signid.export(driven(20.0), "actuators").text


@pytest.mark.parametrize("unknown", [{"kp": 20.0, "kd": None}, {"kd": None}])
def test_a_damping_that_acts_is_not_left_out(unknown: dict[str, float | None]) -> None:
    """Its scale alone is unknown: the lag, which damping gives, is identifiable."""
    model = with_servos(load_model("3r"), {"joint_2": Servo(kp=2.6, kd=0.19, not_identifiable=unknown)})
    with pytest.raises(OptionError, match=r"kd of joint_2 is not identifiable.*--known kp\.joint_2=20"):
        signid.export(model, "mjcf")


def test_a_damping_without_effect_is_left_out() -> None:
    servo = Servo(kp=60.0, kd=0.01, delay=0.02, not_identifiable={"kd": None})
    made = signid.export(with_servos(load_model("3r"), {"joint_2": servo}), "mjcf")
    assert "kv=" not in made.text and "left out: kd of joint_2" in made.text


@pytest.mark.parametrize("kind", ["mjcf", "actuators", "ros", "isaaclab", "mjlab"])
def test_numbers_that_are_known_as_a_sum_are_said(kind: str) -> None:
    servo = Servo(kp=60.0, kd=0.8, delay=0.02, combined=("damping", "lag"))
    made = signid.export(with_servos(load_model("3r"), {"joint_1": servo, "joint_2": servo}), kind)
    assert "kd of joint_1, joint_2 is the damping" in made.text and "delay of joint_1, joint_2 is one" in made.text
    assert sum("joint_1, joint_2" in note for note in made.notes) >= 2


def test_a_number_that_is_found_later_is_identifiable() -> None:
    """As a diagnosis finds a friction that an identification could not separate."""
    servo = Servo(kp=60.0, kd=0.8, not_identifiable={"coulomb_friction": None}, combined=("damping",))
    assert servo.with_(delay=0.01) == servo.with_(delay=0.01, coulomb_friction=0.0)
    assert servo.with_(delay=0.01).not_identifiable and servo.with_(delay=0.01).combined
    assert not servo.with_(coulomb_friction=0.2).not_identifiable and not servo.with_(kd=0.2).combined


@pytest.mark.parametrize(
    ("servo", "said"),
    [({"not_identifiable": {"mass": None}}, "mass"), ({"combined": ["kp"]}, "combined")],
)
def test_senseless_marks_are_refused(servo: dict[str, Any], said: str, tmp_path: Path) -> None:
    document = driven(20.0).document()
    document["servos"]["joint_2"] |= servo
    (tmp_path / "model.json").write_text(json.dumps(document))
    with pytest.raises(RobotError, match=said):
        load_model(tmp_path / "model.json")


def test_a_joint_cannot_end_the_comment_of_c() -> None:
    model = load_model("1r")
    text = model.robot.document.replace(f'"{model.robot.joints[0]}"', '"a*/b"')
    hostile = load_model(robot_from_text(text, "urdf", "1r"))
    servo = Servo(kp=20.0, armature=0.7111, not_identifiable={"armature": None})
    made = signid.export(with_servos(hostile, {"a*/b": servo}), "c")
    for part in (made.text, made.beside[".h"]):
        assert "left out: armature" in part and "a*/b" not in part
