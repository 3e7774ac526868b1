"""Misuse of the public verbs ends in a sentence on the argument, and nothing else changes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

import signid
from signid.errors import OptionError, RecordingError, SignidError
from signid.typed import fits, typed
from signid.types import Array

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
