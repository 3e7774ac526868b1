"""JSON: an object for each sample, in lines or in a list; or one object with a list for each column."""

from __future__ import annotations

import json
import re
from array import array
from codecs import BOM_UTF8
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import RecordingError
from ...types import Array, Table
from .base import MOST_COLUMNS, MOST_DEPTH, MOST_PARTS, About, Format, MemoryTable, memory_table, require_memory
from .csv_ import MISSING

LINES = (".jsonl", ".ndjson")
MOST_LINE = 1_000_000  # length of a line [bytes]
TIMES = 15  # peak memory while reading a list or an object [times the size of the text]
BEGINNING = 65_536  # length of the part by which a file is recognised [bytes]
DOCUMENT = re.compile(r'"schema"\s*:\s*"signid\.')  # a result or a model of signid
SAMPLES = re.compile(r"\[\s*-?\d|\}\s*\{")  # a list of numbers, or an object behind another one
EXAMPLE = '{"t": 0.0, "q": [0.1, 0.2], "tau": [1.5, 2.5]}'
Row = dict[str, float | str]


class Json(Format):
    """Read completely; lists become NAME_1 to NAME_n, objects NAME.FIELD, and null is a missing value."""

    name, suffixes = "json", (*LINES, ".json")
    description = "JSON: an object for each line, a list of objects, or an object of lists"

    def open(self, path: Path) -> Table:
        try:
            if DOCUMENT.search(_beginning(path)):
                fault = f"{path} holds a model or a result of signid instead of samples"
                raise RecordingError(f"{fault}; give the recording here")
            if _has_lines(path):
                with path.open("rb") as lines:
                    return _table(path, *_rows(path, lines))
            return _whole(path)
        except OSError as error:
            raise RecordingError(f"{path} cannot be read: {error.strerror}") from error


def parse_row(text: str) -> Row:
    """Numbers and texts of a JSON object by column; null and words for missing values are NaN.

    Raises:
        ValueError: no JSON object, one that is nested too deeply, or one that gives a column twice.
    """
    content = _parsed(text)
    if not isinstance(content, dict):
        raise ValueError("it is no object")
    return _flat(content)


def holds_samples(path: Path) -> bool:
    """Whether a file of JSON looks like samples, and not like a result, a model or a configuration."""
    if not path.is_file():
        return False
    text = _beginning(path)
    return text.startswith(("{", "[")) and not DOCUMENT.search(text) and bool(SAMPLES.search(text) or text[0] == "[")


def _beginning(path: Path) -> str:
    with path.open("rb") as file:
        return file.read(BEGINNING).decode("utf-8-sig", "replace").lstrip()


def _parsed(text: str) -> Any:
    """Content of JSON, with all numbers as floats.

    Raises:
        ValueError: no JSON, a key that repeats, or objects nested too deeply.
    """
    try:
        return json.loads(text, parse_int=float, object_pairs_hook=_unique)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _unique(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        keys = [key for key, _ in pairs]
        raise ValueError(f"it has the key {next(key for key in keys if keys.count(key) > 1)!r} twice")
    return content


def _flat(content: Mapping[str, Any]) -> Row:
    row: Row = {}
    for name, value in _leaves(content, "", 0):
        if name in row:
            raise ValueError(f"it gives the column {name!r} twice")
        missing = value is None or (isinstance(value, str) and (value in MISSING or value.lower() == "nan"))
        row[name] = float("nan") if missing else value if isinstance(value, str) else float(value)
    return row


def _leaves(value: Any, name: str, depth: int) -> Iterator[tuple[str, Any]]:
    if depth > MOST_DEPTH:
        raise ValueError("it is nested too deeply")
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _leaves(part, f"{name}.{key}" if name else key, depth + 1)
    elif isinstance(value, list) and len(value) > MOST_PARTS:
        yield name, f"a list of {len(value)}"
    elif isinstance(value, list):
        for k, part in enumerate(value, 1):
            yield from _leaves(part, f"{name}_{k}", depth + 1)
    else:
        yield name, value


def _has_lines(path: Path) -> bool:
    """Whether each line is an object of its own."""
    with path.open("rb") as file:
        first = next((bare for line in iter(partial(file.readline, MOST_LINE), b"") if (bare := _bare(line))), b"")
        if path.suffix.lower() in LINES:
            return not first.startswith(b"[")
        try:
            parse_row(first.decode())
        except ValueError:
            return False
        return any(line.strip() for line in file)


def _rows(path: Path, lines: Iterable[bytes]) -> tuple[Iterator[Row], list[str]]:
    """Samples of lines, and notes that are complete when all are read."""
    notes: list[str] = []

    def rows() -> Iterator[Row]:
        for number, line in enumerate(lines, 1):
            if len(line) > MOST_LINE:
                fault = f"has more than {MOST_LINE / 1e6:.0f} MB in line {number}"
                raise RecordingError(f"{path} {fault}; write an object for each sample in a line of its own")
            if not (bare := _bare(line)):
                continue
            try:
                yield parse_row(bare.decode())
            except ValueError as error:
                if number > 1 and not line.endswith(b"\n"):
                    notes.append(f"line {number} is cut short and left out")
                    return
                why = "it is not UTF-8" if isinstance(error, UnicodeDecodeError) else str(error)
                if isinstance(error, json.JSONDecodeError):
                    why = f"{error.msg} at character {error.pos + 1}"
                fault = f"{path} has no JSON object in line {number} ({why})"
                raise RecordingError(f"{fault}; expected a line such as {EXAMPLE} for each sample") from error

    return rows(), notes


def _bare(line: bytes) -> bytes:
    """Line without blanks around it, and without a byte order mark."""
    return line.removeprefix(BOM_UTF8).strip()


def _whole(path: Path) -> Table:
    require_memory(path, TIMES * path.stat().st_size)
    try:
        content = _parsed(path.read_bytes().decode("utf-8-sig"))
        if isinstance(content, dict):
            listed = [value for value in content.values() if _are_objects(value)]
            if len(listed) != 1:
                return memory_table(_arrays(content, 0), str(path))
            content = listed[0]
        if _are_objects(content):
            return _table(path, map(_flat, content), [])
        why = "it is no list of objects"
    except ValueError as error:
        if isinstance(error, RecordingError):
            raise
        why = "it is not UTF-8" if isinstance(error, UnicodeDecodeError) else str(error)
    expected = f"expected a list of objects such as {EXAMPLE}, or one object with a list for each column"
    raise RecordingError(f"{path} is no JSON of samples, or is cut short ({why}); {expected}")


def _are_objects(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(item, dict) for item in value)


def _arrays(content: Mapping[str, Any], depth: int) -> dict[str, Any]:
    """Arrays of the lists of an object, and groups of the objects in it; texts stay texts.

    Raises:
        ValueError: objects nested too deeply.
    """
    if depth > MOST_DEPTH:
        raise ValueError("it is nested too deeply")
    arrays: dict[str, Any] = {}
    for name, value in content.items():
        try:
            arrays[name] = _arrays(value, depth + 1) if isinstance(value, dict) else np.array(value, np.float64)
        except (TypeError, ValueError):
            if isinstance(value, dict):
                raise
            arrays[name] = ""
    return arrays


@dataclass
class _Column:
    """Values of the rows that have them."""

    rows: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))
    fault: str = ""


def _table(path: Path, samples: Iterable[Row], notes: Sequence[str]) -> MemoryTable:
    """Table of samples that may lack values, which become NaN."""
    columns: dict[str, _Column] = {}
    count = 0
    for count, sample in enumerate(samples, 1):  # noqa: B007
        for name, value in sample.items():
            column = columns.get(name)
            if column is None:
                if len(columns) >= MOST_COLUMNS:
                    raise RecordingError(f"{path} has more than {MOST_COLUMNS} columns; write only those of the robot")
                column = columns[name] = _Column()
            if isinstance(value, str):
                column.fault = column.fault or f"holds {value[:40]!r} in row {count}, expected a number or null"
            else:
                column.rows.append(count - 1)
                column.values.append(value)
    if not count:
        raise RecordingError(f"{path} is empty; expected a line such as {EXAMPLE} for each sample")
    require_memory(path, 8.0 * count * len(columns))
    usable: dict[str, Array] = {}
    for name, column in columns.items():
        if not column.fault:
            usable[name] = np.full(count, np.nan)
            usable[name][np.frombuffer(column.rows, np.int64)] = column.values
    faults = {name: column.fault for name, column in columns.items() if column.fault}
    return MemoryTable(usable, faults, str(path), About(tuple(notes)))


PLUGIN = Json()
