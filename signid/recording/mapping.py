"""The column map: which column of a source stands for which signal, by which name joints go, and in which units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import RecordingError, shorten
from ..toml_json import read_toml
from .units import OF, Change, change_of

KINDS = ("abs_current", "abs_tau", "current", "q_des", "ddq", "dq", "tau", "q")  # longer prefixes first
FIELDS = ("column", "unit", "scale", "offset")  # of a column in the long form

ColumnMap = str | Path | Mapping[str, Any]


class Signal(NamedTuple):
    """A column of the source and what it stands for."""

    logical: str  # "q_elbow"
    column: str  # "elbow_pos"
    mapped: bool


class Columns(NamedTuple):
    """A column map that has been read."""

    named: Mapping[str, str]  # column by logical name
    own: Mapping[str, str | Change]  # unit, or scale and offset, of such a column, by logical name
    units: Mapping[str, str]  # by kind: q, tau, t, ...
    joints: Mapping[str, str]  # name of a joint by the source's name for it
    pattern: tuple[str, str] | None  # what stands before and behind the name of a joint

    def change(self, signal: Signal, kind: str, prismatic: bool | None, source: str) -> Change | None:
        """What makes the column's unit that of recordings, None where nothing is said of it.

        Raises:
            RecordingError: the unit is none of such a column.
        """
        own = self.own.get(signal.logical) if signal.mapped else None
        if isinstance(own, Change):
            return own
        unit = own or self.units.get(kind)
        return None if unit is None else change_of(unit, kind, prismatic, f"{source}: column {signal.column!r}")

    def signals(self, columns: Sequence[str], source: str) -> Iterator[Signal]:
        """Columns under the names that the map gives them; one that it takes no longer stands for its own name.

        Raises:
            RecordingError: a column of the map is not there.
        """
        for key, column in self.named.items():
            if column not in columns:
                raise RecordingError(f"{source} has no column {column!r} for {key}; it has {shorten(columns, 12)}")
            yield Signal(key, column, True)
        taken = {*self.named, *self.named.values()}
        yield from (Signal(self._renamed(name), name, False) for name in columns if name not in taken)

    def _renamed(self, name: str) -> str:
        for kind, token in split(name):
            if token in self.joints:
                return f"{kind}_{self.joints[token]}"
            if self.pattern and token.startswith(self.pattern[0]) and token.endswith(self.pattern[1]):
                inner = token[len(self.pattern[0]) : len(token) - len(self.pattern[1])]
                return f"{kind}_{inner}" if inner else name
        return name


def split(logical: str) -> list[tuple[str, str]]:
    """The kinds and joints that a name may be made of, the longest kind first."""
    return [(kind, logical[len(kind) + 1 :]) for kind in KINDS if logical.startswith(kind + "_")]


def read_map(given: ColumnMap | None, units: Mapping[str, str] | None = None) -> Columns:
    """A column map, from a TOML file or as it is.

    Args:
        given: column by logical name, "elbow_pos" or {"column": "elbow_pos", "unit": "deg"}; `joints` and `units`.
        units: by kind of column; they count before those of the map.

    Raises:
        RecordingError: it cannot be read, or says what cannot be.
    """
    name, table = ("the column map", given or {}) if given is None or isinstance(given, Mapping) else _from_file(given)
    named: dict[str, str] = {}
    own: dict[str, str | Change] = {}
    for key, value in table.items():
        if key in ("joints", "units"):
            continue
        if key != "t" and not split(key):
            raise RecordingError(f"{name} gives {key!r}; expected t, or {'_, '.join(reversed(KINDS))}_ and a joint")
        named[key], said = _column(name, key, value)
        own |= {key: said} if said else {}
    for key, column in named.items():
        if twin := next((k for k, other in named.items() if other == column and k != key), None):
            raise RecordingError(f"{name} uses column {column!r} for both {key} and {twin}; each needs its own")
    joints, pattern = _joints(name, table.get("joints", {}))
    asked = {**_units(name, table.get("units", {})), **_units("--unit", units or {})}
    return Columns(named, own, asked, joints, pattern)


def _from_file(path: str | Path) -> tuple[str, Mapping[str, Any]]:
    name = f"column map {path}"
    try:
        return name, read_toml(path)
    except OSError as error:
        raise RecordingError(f"{name} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise RecordingError(f'{name} is not TOML such as q_elbow = "elbow_pos": {error}') from error


def _column(name: str, key: str, value: object) -> tuple[str, str | Change]:
    """The column of a logical name, and what is said of its unit."""
    if isinstance(value, str):
        return value, ""
    if not isinstance(value, Mapping) or not isinstance(value.get("column"), str):
        form = f'{key} = "name" or {key} = {{ column = "name", unit = "deg" }}'
        raise RecordingError(f"{name} gives {key} = {value!r}; expected the name of a column, {form}")
    if strange := [field for field in value if field not in FIELDS]:
        raise RecordingError(f"{name} says {strange[0]!r} of {key}; expected {', '.join(FIELDS)}")
    unit, numbers = value.get("unit", ""), [value.get(field) for field in ("scale", "offset")]
    if not isinstance(unit, str) or (unit and any(number is not None for number in numbers)):
        raise RecordingError(f"{name} gives {key} the unit {unit!r}; expected a unit, or scale and offset, not both")
    if all(number is None for number in numbers):
        return value["column"], unit
    scale, offset = (default if x is None else x for x, default in zip(numbers, (1.0, 0.0), strict=True))
    if (
        any(isinstance(x, bool) or not isinstance(x, int | float) or not isfinite(x) for x in (scale, offset))
        or not scale
    ):
        raise RecordingError(f"{name} gives {key} a scale or offset that is no number; expected value * scale + offset")
    return value["column"], Change(float(scale), 1.0, float(offset))


def _units(name: str, table: object) -> dict[str, str]:
    if not isinstance(table, Mapping):
        raise RecordingError(f'{name} gives units = {table!r}; expected lines such as q = "deg" below [units]')
    for kind, unit in table.items():
        if kind not in OF or not isinstance(unit, str):
            raise RecordingError(f"{name} gives the unit {unit!r} to {kind!r}; expected {', '.join(OF)} and a unit")
        change_of(unit, kind, None, f"{name}: {kind}")
    return dict(table)


def _joints(name: str, given: object) -> tuple[dict[str, str], tuple[str, str] | None]:
    if isinstance(given, str) and given.count("*") == 1:
        before, _, behind = given.partition("*")
        return {}, (before, behind)
    if not isinstance(given, Mapping) or not all(isinstance(token, str) for token in given.values()):
        form = 'joints = "left_arm/*", or below [joints] lines such as elbow = "left_elbow"'
        raise RecordingError(f"{name} gives joints = {given!r}; expected {form}")
    joints = {token: joint for joint, token in given.items()}
    if len(joints) < len(given):
        raise RecordingError(f"{name} gives two joints the same name of the recording; each needs its own")
    return joints, None
