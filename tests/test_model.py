"""A model of a robot is saved and loaded again, and predicts the torque of a motion."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from motions import trial
from numpy.testing import assert_allclose

import signid
from signid.effects import EFFECTS
from signid.effects.law import law_columns
from signid.errors import RobotError
from signid.identify import Identification
from signid.model import Model, load_model, stated_inertials
from signid.motion import Motion
from signid.types import Array, Law, Robot


@pytest.fixture(scope="module")
def arm() -> Robot:
    return signid.load_robot("3r")


@pytest.fixture(scope="module")
def found(arm: Robot) -> Identification:
    return signid.identify(arm, [trial(arm).noisy()])


def test_a_model_predicts_the_torque_and_loads_back(found: Identification, arm: Robot, tmp_path: Path) -> None:
    made = trial(arm, seed=7)
    motion = Motion(arm, made.t, made.q, made.v, made.a)
    predicted = found.model.inverse(motion)
    assert np.sqrt(np.mean((predicted - made.torque) ** 2)) < 0.05
    path = tmp_path / "model.json"
    path.write_text(json.dumps(found.model.document()))
    again = load_model(path)
    assert_allclose(again.inverse(Motion(again.robot, made.t, made.q, made.v, made.a)), predicted, atol=1e-12)


def test_a_held_joint_stays_held_in_the_saved_model(arm: Robot, tmp_path: Path) -> None:
    held = signid.load_robot("3r", lock={"joint_2": 0.4})
    found = signid.identify(held, [trial(held).recording()])
    path = tmp_path / "model.json"
    path.write_text(json.dumps(found.model.document()))
    again = load_model(path)
    assert again.robot.joints == ("joint_1", "joint_3")
    motion = trial(held, seed=3)
    here, there = (m.inverse(Motion(m.robot, motion.t, motion.q, motion.v, motion.a)) for m in (found.model, again))
    assert_allclose(there, here, atol=1e-12)


def test_a_robot_is_a_simulation_too() -> None:
    model = load_model("3r")
    made = trial(model.robot)
    motion = Motion(model.robot, made.t, made.q, made.v, made.a)
    assert_allclose(model.inverse(motion), motion.load + sum(law_torque(model, motion)), atol=1e-9)


def law_torque(model: Model, motion: Motion) -> list[Array]:
    total = [np.zeros_like(motion.q)]
    for law in model.laws:
        rows, columns = law_columns(law, motion)
        part = np.zeros_like(motion.q)
        part[:, list(rows)] = columns @ np.array(law.effect.coefficients(law.parameters))
        total.append(part)
    return total


def test_what_is_no_model_is_refused(arm: Robot, tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    unknown = Model(arm, stated_inertials(arm), (Law(EFFECTS["armature"], (0,), {"inertia": 1.0}),)).document()
    unknown["effects"][0]["joint"] = "elbow"
    for text in ("{", "[]", '{"schema": "else"}', '{"schema": "signid.model/1"}', json.dumps(unknown)):
        path.write_text(text)
        with pytest.raises(RobotError) as caught:
            load_model(path)
        assert "\n" not in str(caught.value)
