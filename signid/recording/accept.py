"""Recordings as users give them: one or several, read already, as paths, arrays or frames."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from ..errors import OptionError, unexpected
from ..types import Recording, Robot
from .read import read_recording
from .source import Source

Recordings = Recording | Source | Sequence[Recording | Source]


def as_recordings(given: object, robot: Robot, verb: str) -> list[Recording]:
    """Recordings of a robot; paths, arrays by column name and frames are read with the usual column names.

    Raises:
        OptionError: anything else was given to the verb.
        RecordingError: a file cannot be read.
    """
    several = isinstance(given, Sequence | Iterator) and not isinstance(given, str | bytes)
    found = []
    for each in given if several else [given]:  # type: ignore[attr-defined]
        if not (isinstance(each, Recording) or _is_source(each)):
            advice = 'signid.read_recording("recording.csv", robot)'
            raise unexpected(verb, "a Recording or a list of them", each, advice)
        found.append(each if isinstance(each, Recording) else read_recording(each, robot))
    return found


def as_recording(given: object, robot: Robot, verb: str) -> Recording:
    """Return the only recording that is given.

    Raises:
        OptionError: anything else, or several recordings were given to the verb.
    """
    found = as_recordings(given, robot, verb)
    if len(found) != 1:
        raise OptionError(f"{verb} needs one recording, not {len(found)}; give one of them")
    return found[0]


def _is_source(given: Any) -> bool:
    if isinstance(given, np.ndarray):
        return given.dtype.names is not None
    frame = hasattr(given, "iloc") or hasattr(given, "__arrow_c_stream__") or isinstance(given, pl.LazyFrame)
    return frame or isinstance(given, str | Path | Mapping)
