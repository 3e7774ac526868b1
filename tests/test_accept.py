"""Verbs accept what stands for a robot, a model or recordings, and name the expected type otherwise."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import signid

HERE = Path(__file__).parents[1] / "robots" / "3r"
RECORDING, HELD_OUT = str(HERE / "recording.parquet"), HERE / "held_out.parquet"


@pytest.fixture(scope="module")
def robot() -> Any:
    return signid.load_robot("3r")


def test_all_ways_to_give_robot_and_recordings_agree(robot: Any) -> None:
    recording, held_out = (signid.read_recording(path, robot) for path in (RECORDING, HELD_OUT))
    expected = signid.identify(robot, [recording], held_out=[held_out]).base_value
    model = signid.load_model(robot)
    for given in (
        signid.identify("3r", RECORDING, held_out=HELD_OUT),
        signid.identify(model, recording, held_out=held_out),
        signid.identify(robot, (RECORDING,), held_out=[HELD_OUT]),
        signid.identify(robot, pl.read_parquet(RECORDING), held_out=iter([held_out])),
    ):
        assert np.array_equal(given.base_value, expected)


def test_models_are_given_as_results_robots_and_paths(robot: Any, tmp_path: Path) -> None:
    result = signid.identify(robot, RECORDING)
    path = result.model.save(tmp_path / "model.json")
    models = (result, result.model, path, str(path))
    first, *others = (signid.roll_out(model, HELD_OUT).error for model in models)
    assert all(np.array_equal(other, first) for other in others)
    found = signid.validate([result, "3r", robot], [HELD_OUT])
    assert [one.name for one in found.models] == ["3r", "3r (2)", "3r (3)"]
    rms = [one.fit.held_out_rms.sum() for one in found.models]
    assert rms[0] < 0.2 * rms[1] and rms[1] == rms[2]
    assert signid.export(result, "mjcf").text == signid.export(path, "mjcf").text
    assert "3r" in signid.replay(result, HELD_OUT).title


WRONG: dict[str, Callable[[Any, Any], Any]] = {
    r"identify needs a Robot, not Recording; give signid.load_robot\(": lambda r, x: signid.identify(x, r),
    r"identify needs a Recording or a list of them, not Robot; give signid.read_rec": lambda r, x: signid.identify(
        r, r
    ),
    "identify needs a Recording or a list of them, not float": lambda r, x: signid.identify(r, [x, 1.0]),
    "identify needs a Recording or a list of them, not int": lambda r, x: signid.identify(r, x, held_out=3),
    "check needs a Recording or a list of them, not None": lambda r, x: signid.check(r, None),
    "inspect needs a Robot, not Recording": lambda r, x: signid.inspect(x),
    r"diagnose needs a Model, not Recording; give signid.load_model\(": lambda r, x: signid.diagnose(x, x),
    "validate needs a Model, not Recording": lambda r, x: signid.validate(x, x),
    "payload needs a Recording or a list of them, not Robot": lambda r, x: signid.payload(r, x, r),
    "inspect needs a Robot, not int": lambda r, x: signid.inspect(3),
    "roll_out needs a Model, not list": lambda r, x: signid.roll_out([r], x),
    "replay needs one recording, not 2": lambda r, x: signid.replay(r, [x, x]),
    "export needs a Model, not Recording": lambda r, x: signid.export(x, "urdf"),
    "excite needs a Model, not None": lambda r, x: signid.excite(None),
    "simulate needs a Model, not Recording": lambda r, x: signid.simulate(x, x, 1.0),
    "record needs a Simulation, not Robot": lambda r, x: signid.record(r, r),
    "report needs a Check, a Diagnosis, an Identification or a Validation, not Robot": lambda r, x: signid.report(r),
    "read_recording needs a Robot, not None": lambda r, x: signid.read_recording(RECORDING, None),
    "load_robot needs a path or the name of a robot, not None": lambda r, x: signid.load_robot(None),
    "load_model needs a path, the name of a robot or a Robot, not Recording": lambda r, x: signid.load_model(x),
}


@pytest.mark.parametrize("sentence", WRONG)
def test_another_type_is_refused_with_the_expected_one(sentence: str, robot: Any) -> None:
    recording = signid.read_recording(HELD_OUT, robot)
    with pytest.raises(signid.SignidError, match=sentence):
        WRONG[sentence](robot, recording)
