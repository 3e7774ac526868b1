"""Verbs accept what stands for a robot, a model or recordings; misuse ends in a sentence on the argument."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import polars as pl
import pytest

import signid
from signid.errors import OptionError, RecordingError, SignidError
from signid.typed import fits, typed
from signid.types import Array

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


T = np.arange(0, 5, 0.01)
COLUMNS = {"t": T, "q": np.sin(T)[:, None], "tau": np.cos(T)[:, None]}


@pytest.mark.parametrize(
    ("value", "hint", "right"),
    [
        (3, float, True),
        (np.float32(3), float, True),
        (True, float, False),
        ("3", float, False),
        (3.0, int, False),
        (np.int64(3), int, True),
        (None, int | None, True),
        ("x", int | None, False),
        ("ab", Sequence[str], False),
        (["a", "b"], Sequence[str], True),
        (["a", 1], Sequence[str], False),
        ((1.0, 2.0), tuple[float, float], True),
        ((1.0,), tuple[float, float], False),
        ({"a": 1.0}, Mapping[str, float], True),
        ({"a": "b"}, Mapping[str, float], False),
        ([[1, 2], [3, 4]], Array, True),
        ([[1, 2], [3]], Array, False),
        (len, Callable[[str], int], True),
        (5, Callable[[str], int], False),
        ("exact", Literal["exact", "tree"], True),
        ("other", Literal["exact", "tree"], False),
        (Path("x"), str | Path, True),
        (object(), Any, True),
    ],
)
def test_values_of_annotated_types(value: Any, hint: Any, right: bool) -> None:
    assert fits(value, hint) == right


def test_a_failure_of_right_arguments_stays_as_it_is() -> None:
    @typed
    def verb(count: int) -> int:
        return 1 // count

    assert verb(1) == 1
    with pytest.raises(ZeroDivisionError):
        verb(0)
    with pytest.raises(OptionError, match="verb: count is str, or holds another type; expected int"):
        verb("a")  # type: ignore[arg-type]
    with pytest.raises(OptionError, match="verb: .*unexpected keyword argument 'size'; it takes count"):
        verb(1, size=2)  # type: ignore[call-arg]


@pytest.mark.parametrize("options", [5, "x", {"cutoff": 3}, np.zeros(3)])
def test_wrong_options_are_named(options: Any) -> None:
    recording = signid.read_recording(COLUMNS, "1r")
    for verb in (signid.identify, signid.diagnose):
        with pytest.raises(OptionError, match=r"options is \w+, or holds another type; expected Options \| None"):
            verb("1r", [recording], options=options)


def test_ragged_rows_and_columns_of_a_frame_are_no_recording() -> None:
    import pandas as pd

    with pytest.raises(RecordingError, match="rows of q have different lengths"):
        signid.read_recording({**COLUMNS, "q": [[1.0], [2.0, 3.0]]}, "1r")
    with pytest.raises(RecordingError, match="cannot be read from Series"):
        signid.read_recording(pd.Series([1.0, 2.0]), "1r")
    with pytest.raises(SignidError, match="no recording was given"):
        signid.identify_servos("1r", [])
