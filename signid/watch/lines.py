"""Lines of CSV or JSON -> rows of a robot's joints, with the column names and units of recordings."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from ..errors import RecordingError
from ..recording import read_recording
from ..recording.names.mapping import ColumnMap
from ..types import Array, Recording, Robot
from .intake import StreamRows

MOST, MOST_COLUMNS = 1_000_000, 2_000  # characters of a line, columns of a stream
PROBE = 64  # rows of zeros and ones that show the conversion of each column
VECTORS = ("q", "tau", "current", "dq")  # keys of JSON lines that may hold a number for each joint


class Parser:
    """Rows from text that arrives in pieces; lines that are no rows become rows of NaN."""

    def __init__(self, robot: Robot, columns: ColumnMap | None, name: str) -> None:
        self.robot, self.columns, self.name = robot, columns, name
        self.rest: list[str] = []  # pieces of the line that is not complete
        self.header: list[str] | None = None
        self.convert: Callable[[Array], StreamRows] | None = None
        self.joints: tuple[str, ...] = ()
        self.json = False

    def rows(self, text: str) -> StreamRows | None:
        """Rows of the complete lines; None without one.

        Raises:
            RecordingError: a line is too long, or the first one is no header.
        """
        *lines, rest = text.split("\n")
        if lines:
            lines[0] = "".join((*self.rest, lines[0]))
            self.rest = []
        self.rest.append(rest)
        if sum(map(len, self.rest)) > MOST or any(len(line) > MOST for line in lines):
            raise RecordingError(
                f"{self.name} has a line of more than {MOST} characters; give one row of CSV or JSON per line"
            )
        found = [values for line in lines if (values := self._values(line.strip())) is not None]
        if not found:
            return None
        assert self.convert is not None, "the first row sets it"
        return self.convert(np.array(found))

    def _values(self, line: str) -> list[float] | None:
        """Numbers of a line in the order of the header; None for the header and empty lines."""
        if not line:
            return None
        if self.header is None:
            self.json = line.startswith("{")
            names = list(self._flat(line) or ()) if self.json else [part.strip().strip('"') for part in line.split(",")]
            self._begin(names, line)
            if not self.json:
                return None
        assert self.header is not None, "the first line sets it"
        lost = [float("nan")] * len(self.header)
        if self.json:
            values = self._flat(line)
            return lost if values is None else [values.get(name, float("nan")) for name in self.header]
        parts = line.split(",")
        if len(parts) != len(self.header):
            return lost
        try:
            return [float(part) for part in parts]
        except ValueError:
            return None if [part.strip().strip('"') for part in parts] == self.header else _forgiving(parts)

    def _flat(self, line: str) -> dict[str, float] | None:
        """Numbers of a JSON object by column; arrays become one column for each joint."""
        try:
            content: Any = json.loads(line)
            out: dict[str, float] = {}
            for key, value in content.items():
                if isinstance(value, list):
                    if key in VECTORS and len(value) == len(self.robot.joints):
                        pairs = zip(self.robot.joints, value, strict=True)
                        out |= {f"{key}_{joint}": _number(x) for joint, x in pairs}
                elif isinstance(value, int | float) or value is None:
                    out[str(key)] = _number(value)
        except (AttributeError, TypeError, ValueError, OverflowError, RecursionError):
            return None
        return out

    def _begin(self, names: Sequence[str], line: str) -> None:
        """Assign the columns.

        Raises:
            RecordingError: the header, or the first object, has no such columns.
        """
        if len(set(names)) < 2:
            raise RecordingError(
                f"{self.name} begins with {line[:60]!r}; give a header of CSV such as t,q_1,tau_1 or JSON objects"
            )
        if len(names) > MOST_COLUMNS:
            raise RecordingError(
                f"{self.name} has {len(names)} columns, more than {MOST_COLUMNS}; give those of the robot"
            )
        if repeated := [name for name, count in Counter(names).items() if name and count > 1]:
            raise RecordingError(
                f"{self.name} names column {repeated[0]!r} twice in its header; give each its own name"
            )
        self.header = list(names)
        self.joints, self.convert = assign(self.header, self.robot, self.columns, self.name)


def assign(
    names: Sequence[str], robot: Robot, columns: ColumnMap | None, name: str
) -> tuple[tuple[str, ...], Callable[[Array], StreamRows]]:
    """Joints of columns, and the conversion of their values (N, columns) to rows.

    Raises:
        RecordingError: the columns are none of a recording with signed torque.
    """
    probe = np.tile(np.arange(PROBE, dtype=float)[:, None] / PROBE, (1, len(names)))
    try:
        found = read_recording(dict(zip(names, probe.T, strict=True)), robot, columns=columns)
    except RecordingError as error:
        raise RecordingError(str(error).replace("the recording", name)) from None
    check(found, name)
    samples, place = found.read(), {column: k for k, column in enumerate(names)}
    parts: list[tuple[list[int], Array, Array]] = []
    for key, values in (("t", samples.t[:, None]), ("q", samples.q), ("tau", samples.tau), ("dq", samples.dq)):
        if values is None or not all(found.columns[key]):
            continue
        offset = values[0]
        parts.append(([place[c] for c in found.columns[key]], (values[-1] - offset) * PROBE / (PROBE - 1), offset))

    def convert(table: Array) -> StreamRows:
        t, *others = (table[:, columns] * factor + offset for columns, factor, offset in parts)
        return StreamRows(t[:, 0], *others)

    return found.joints, convert


def check(recording: Recording, name: str) -> None:
    """Check that the torque of every joint is recorded, with its sign and in N.m.

    Raises:
        RecordingError: it is not.
    """
    if lacking := [j for j, column in zip(recording.joints, recording.columns["tau"], strict=True) if not column]:
        raise RecordingError(f"{name} has no torque of {', '.join(lacking)}; give tau_J or current_J of every joint")
    if not recording.signed.all():
        raise RecordingError(f"{name} has torque without its sign, which a watch cannot use; give tau_J or current_J")
    if recording.scaled is not None:
        raise RecordingError(f"{name} has currents of unknown torque constants; state them in the actuators file")


def played(recording: Recording, size: int) -> Iterator[StreamRows]:
    """Rows of a recording in chunks."""
    for start in range(0, len(recording), size):
        samples = recording.read(start, start + size)
        yield StreamRows(samples.t, samples.q, samples.tau, samples.dq)


def _number(x: Any) -> float:
    return float("nan") if x is None else float(x)


def _forgiving(parts: Sequence[str]) -> list[float]:
    """Numbers, NaN for what is none."""
    out = []
    for part in parts:
        try:
            out.append(float(part))
        except ValueError:
            out.append(float("nan"))
    return out
