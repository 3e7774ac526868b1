"""Models with position drives are saved and loaded, and hold no law twice."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

import signid
from signid.errors import RobotError
from signid.model import SERVO_LAWS, Model, load_model, with_servos
from signid.servos import Servo
from signid.toml_json import SCHEMAS

DUTY = Servo(law="duty", kp=1.1, kd=0.05, delay=0.01, effort_limit=0.8, coulomb_friction=0.1, torque_offset=-0.2)
REGISTER = Servo(kp=20.0, kd=0.5, kp_register=400.0)


@pytest.fixture
def servo_model() -> Model:
    """The 3r with drives at two of its joints."""
    return with_servos(load_model("3r"), {"joint_1": DUTY, "joint_3": REGISTER})


def test_a_model_with_servos_loads_back(servo_model: Model, tmp_path: Path) -> None:
    path = servo_model.save(tmp_path / "model.json")
    content = json.loads(path.read_text())
    assert "speed_limit" not in content["servos"]["joint_1"], "infinite numbers are left out"
    assert not list(Draft202012Validator(json.loads((SCHEMAS / "model.json").read_text())).iter_errors(content))
    assert signid.load_model(path).servos == {"joint_1": DUTY, "joint_3": REGISTER}


def test_laws_of_a_servo_joint_move_into_its_drive(tmp_path: Path) -> None:
    (tmp_path / "actuators.toml").write_text("[joint.joint_1]\narmature = 0.1\n[joint.joint_2]\narmature = 0.2\n")
    stated = load_model("3r", actuators=tmp_path / "actuators.toml")
    driven = with_servos(stated, {"joint_1": DUTY})
    assert len(stated.laws) == 2
    assert [(law.effect.name, law.joints) for law in driven.laws] == [("armature", (1,))]
    assert all(hasattr(DUTY, name) for name in SERVO_LAWS)


@pytest.mark.parametrize(
    ("place", "value", "what"),
    [
        ("law", "magic", "magic"),
        ("kp", -1.0, "kp"),
        ("kp", "stiff", "kp"),
        ("kp", float("nan"), "kp"),
        ("delay", 1e300, "delay"),
        ("effort_limit", float("inf"), "effort_limit"),
        ("kp_register", 0, "kp_register"),
        ("colour", 1, "colour"),
    ],
)
def test_a_wrong_drive_is_refused(place: str, value: Any, what: str, servo_model: Model, tmp_path: Path) -> None:
    document = servo_model.document()
    document["servos"]["joint_1"][place] = value
    path = tmp_path / "model.json"
    path.write_text(json.dumps(document))
    with pytest.raises(RobotError, match=what) as refused:
        load_model(path)
    assert "\n" not in str(refused.value)


def test_a_drive_of_a_strange_joint_is_refused(servo_model: Model, tmp_path: Path) -> None:
    document = servo_model.document()
    document["servos"]["elbow\n<b>"] = document["servos"].pop("joint_1")
    path = tmp_path / "model.json"
    path.write_text(json.dumps(document))
    with pytest.raises(RobotError, match="no joint"):
        load_model(path)
