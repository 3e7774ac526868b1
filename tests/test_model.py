"""A model of a robot is saved and loaded again, and predicts the torque of a motion."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motions import trial
from numpy.testing import assert_allclose

import signid
from signid.effects import EFFECTS
from signid.errors import RobotError
from signid.identify import Identification
from signid.model import Model, load_model, stated_inertials
from signid.regression.motion import Motion
from signid.types import Law, Robot


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


def written(folder: Path, document: Any) -> Path:
    path = folder / "model.json"
    path.write_text(json.dumps(document))
    return path


def test_a_model_carries_the_covariance_of_its_base_parameters(found: Identification, tmp_path: Path) -> None:
    document = found.model.document()
    assert set(document["covariance"]) == {"names", "values", "terms", "lower_triangle"}
    kept = load_model(written(tmp_path, document)).covariance
    assert kept is not None and found.model.covariance is not None
    assert kept.expressions == found.base.expressions and len(set(kept.labels)) == len(kept.labels)
    assert kept.labels[:3] == ("m_1", "mx_1", "my_1")
    assert_allclose(kept.values, found.base_value)
    assert_allclose(kept.std, found.estimate.std, rtol=1e-5)
    assert_allclose(kept.combination, found.model.covariance.combination, atol=1e-9)
    stated = dict(zip((label.name for label in found.base.labels), found.parameters.values, strict=True))
    assert_allclose(kept.combination @ [stated[name] for name in kept.labels], found.base_value, atol=1e-9)
    share = np.linalg.solve(found.estimate.covariance, kept.matrix)
    assert_allclose(np.linalg.eigvals(share).real, 1, atol=0.05)  # no direction has lost its width


def test_an_edited_model_keeps_the_covariance_and_an_old_one_has_none(found: Identification, tmp_path: Path) -> None:
    document = found.model.document()
    last = found.robot.links[-1]
    document["effects"] = [law for law in document["effects"] if law["effect"] != "coulomb_friction"]
    document["standard_parameters"][last]["mass"] += 1.0
    edited = load_model(written(tmp_path, document))
    assert len(edited.laws) < len(found.model.laws) and edited.covariance is not None
    assert_allclose(edited.covariance.values, found.base_value)
    del document["covariance"]
    assert load_model(written(tmp_path, document)).covariance is None


def test_an_infinite_variance_is_written_as_null(found: Identification, tmp_path: Path) -> None:
    known = found.model.covariance
    assert known is not None
    matrix = known.matrix.copy()
    matrix[2, 2] = np.inf
    document = replace(found.model, covariance=replace(known, matrix=matrix)).document()
    assert document["covariance"]["lower_triangle"].count(None) == 1
    kept = load_model(written(tmp_path, document)).covariance
    assert kept is not None and np.flatnonzero(np.isinf(kept.std)).tolist() == [2]


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda c: c.pop("values"), "'values' is a required property); identify again, or remove"),
        (lambda c: c["values"].pop(), "24"),
        (lambda c: c.update(terms=[1] * 25), "terms[0]: 1 is not of type 'object'); identify again"),
        (lambda c: c["terms"][0].update(Izz_9=1.0), "Izz_9"),
        (lambda c: c["lower_triangle"].__setitem__(0, -1.0), "not positive"),
        (lambda c: c["lower_triangle"].__setitem__(1, 1e9), "negative variance"),
        (lambda c: c["lower_triangle"].__setitem__(1, "x"), "lower_triangle[1]: 'x' is not of type"),
        (lambda c: c["values"].__setitem__(1, float("nan")), "finite"),
    ],
)
def test_a_malformed_covariance_is_refused(change: Any, what: str, found: Identification, tmp_path: Path) -> None:
    document = found.model.document()
    change(document["covariance"])
    with pytest.raises(RobotError) as caught:
        load_model(written(tmp_path, document))
    assert what in str(caught.value) and "covariance" in str(caught.value) and "\n" not in str(caught.value)


def test_friction_below_zero_is_kept_only_in_an_estimate(found: Identification, tmp_path: Path) -> None:
    document = found.model.document()
    law = next(law for law in document["effects"] if law["effect"] == "coulomb_friction")
    law["parameters"]["level"] = -1e-3
    assert load_model(written(tmp_path, document)).laws
    del document["covariance"]
    with pytest.raises(RobotError, match="level is -0.001; give a positive number"):
        load_model(written(tmp_path, document))


def test_invalid_models_are_refused(arm: Robot, tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    unknown = Model(arm, stated_inertials(arm), (Law(EFFECTS["armature"], (0,), {"inertia": 1.0}),)).document()
    unknown["effects"][0]["joint"] = "elbow"
    for text in ("{", "[]", '{"schema": "else"}', '{"schema": "signid.model/1"}', json.dumps(unknown)):
        path.write_text(text)
        with pytest.raises(RobotError) as caught:
            load_model(path)
        assert "\n" not in str(caught.value)
