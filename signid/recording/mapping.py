"""Read and write column maps: signals, joint names and units of the columns of a source."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from itertools import permutations
from math import isfinite
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from ..errors import OptionError, RecordingError, shorten
from ..toml_json import read_json, read_toml
from ..types import Array, Table
from .vocabulary import OF, Change, bracketed, change_of

KINDS = tuple("abs_current abs_tau current dq_des tau_ff q_des volt temp pwm ddq tau dq on q".split())  # longest first
TORQUES = ("tau", "current", "abs_tau", "abs_current")  # in the order of preference
DRIVE = ("on", "pwm", "volt", "temp")  # kinds of columns whose names often mean something else
MOST_SKIPPED = 10_000  # lines before a header
MOST_NAMES = 20_000  # of columns
MIN_HERTZ, MAX_HERTZ = 0.2, 1e5  # [Hz] plausible rates of rows
SHIFTED = ("q", "q_des")  # kinds of columns that a zero shifts
SIGNED = (*SHIFTED, "dq", "dq_des", "ddq", "tau", "tau_ff", "current", "pwm")  # kinds whose sign is that of the joint
FIELDS = ("column", "unit", "scale", "offset")  # keys of a column in the long form
SECTIONS: Mapping[str, tuple[str, ...]] = {  # sections of a reading and their keys, () for signals and joints
    "columns": (),
    "clock": ("time", "rate"),
    "missing": ("values",),
    "torque_constant": (),
    "gravity": ("vector",),
}
ColumnMap = str | Path | Mapping[str, Any]
COUNTS = 4095  # counts of a turn by which LeRobot divides, of motors with 12 bits
PERCENT, PERCENT_ROUNDING = 100.0, 0.5  # largest share of the range, and what rounding adds [%]
KEYS = ("range_min", "range_max")


class DerivedTable:
    """A table that applies functions to some columns of another one as they are read.

    Functions map the values (N,) of a column and the number of their first row to new values (N,); `added` are columns
    (N,) in place of those of the table, or beside them.
    """

    def __init__(
        self,
        table: Table,
        functions: Mapping[str, Callable[[Array, int], Array]],
        added: Mapping[str, Array] = MappingProxyType({}),
    ) -> None:
        self._table, self._functions, self._added = table, functions, added
        self.columns, self.rows = tuple(dict.fromkeys((*added, *table.columns))), table.rows
        self.about = getattr(table, "about", None)

    def read(self, names: Sequence[str], start: int, stop: int) -> Array:
        """Rows start..stop of the named columns, (stop - start, len(names))."""
        inner = [name for name in names if name not in self._added]
        values = np.empty((max(0, min(stop, self.rows) - start), len(names)))
        values[:, [name not in self._added for name in names]] = self._table.read(inner, start, stop)
        for k, name in enumerate(names):
            if name in self._added:
                values[:, k] = self._added[name][start:stop]
            if name in self._functions:
                values[:, k] = self._functions[name](values[:, k], start)
        return values


class Signal(NamedTuple):
    """A column of the source and its signal."""

    logical: str  # "q_elbow"
    column: str  # "elbow_pos"
    mapped: bool
    unit: str = ""  # stated in the name of the column: "rad" of "q_elbow [rad]"


class Heading(NamedTuple):
    """Place of a header and names of columns, where the file does not state them itself."""

    skip: int = 0  # lines before the header
    names: tuple[str, ...] = ()  # of all columns, in place of a header; "" for a column without a name
    rate: float | None = None  # [Hz] of its rows, in place of a column of time; 0: each is a posture at rest


class Turned(NamedTuple):
    """Position of the description = sign * recorded position + zero."""

    sign: int  # 1 or -1
    zero: float  # [rad]


class ParsedColumns(NamedTuple):
    """A parsed column map."""

    named: Mapping[str, str]  # column by signal name
    own: Mapping[str, str | Change]  # unit, or scale and offset, of a named column, by signal name
    units: Mapping[str, str]  # by kind: q, tau, t, ...
    joints: Mapping[str, str]  # joint name by its name in the source
    pattern: tuple[str, str] | None  # prefix and suffix of joint names in the source
    heading: Heading = Heading()
    missing: tuple[float, ...] = ()  # numbers that stand for a missing value
    constants: Mapping[str, float] = MappingProxyType({})  # torque constants by joint [N.m/A or N/A]
    gravity: tuple[float, ...] | None = None  # [m/s2] in the frame of the root link

    def signals(self, columns: Sequence[str], source: str) -> Iterator[Signal]:
        """Columns under their mapped names; a mapped column loses its original name.

        Raises:
            RecordingError: a column of the map is missing.
        """
        plain = {bracketed(name)[0]: name for name in reversed(columns)}
        taken = {*self.named}
        for key, wanted in self.named.items():
            column = wanted if wanted in columns else plain.get(wanted, wanted)
            if column not in columns:
                close = get_close_matches(column, columns, 1)
                meant = f"; did you mean {key} = {json.dumps(close[0], ensure_ascii=False)}?" if close else ""
                fault = f"{source} has no column {column!r} for {key}; it has {shorten(columns, 12)}"
                raise RecordingError(fault + meant)
            taken.add(column)
            yield Signal(key, column, True, bracketed(column)[1])
        for name in columns:
            if name not in taken:
                base, unit = bracketed(name)
                logical = self._renamed(base)
                if unit and logical != "t" and not split(logical):
                    logical, unit = name, ""
                if not (unit and logical in self.named):
                    yield Signal(logical, name, False, unit)

    def _renamed(self, name: str) -> str:
        name = _lower_kind(name)
        for kind, token in split(name):
            if token in self.joints:
                return f"{kind}_{self.joints[token]}"
            if self.pattern and token.startswith(self.pattern[0]) and token.endswith(self.pattern[1]):
                inner = token[len(self.pattern[0]) : len(token) - len(self.pattern[1])]
                return f"{kind}_{inner}" if inner else name
        return name


def _lower_kind(name: str) -> str:
    """A column name whose kind is written as here: Q_1 is q_1, T is t."""
    kinds = (kind for kind in KINDS if name.lower().startswith(f"{kind}_"))
    kind = "t" if name == "T" else next(kinds, "")
    return kind + name[len(kind) :]


def split(logical: str) -> list[tuple[str, str]]:
    """Possible kinds and joints of a signal name, longest kind first."""
    return [(kind, logical[len(kind) + 1 :]) for kind in KINDS if logical.startswith(kind + "_")]


def read_map(
    column_map: ColumnMap | None, units: Mapping[str, str] | None = None, heading: Heading | None = None
) -> ParsedColumns:
    """Parse a column map: a mapping or a TOML file; `units` by kind of column and `heading` override those of the map.

    Raises:
        RecordingError: unreadable or invalid column map.
    """
    if column_map is None or isinstance(column_map, Mapping):
        name, table = "the column map", column_map or {}
    else:
        name = f"column map {column_map}"
        try:
            table = read_toml(column_map)
        except OSError as error:
            raise RecordingError(f"{name} cannot be read: {error.strerror}") from error
        except ValueError as error:
            raise RecordingError(f'{name} is not TOML such as q_elbow = "elbow_pos": {error}') from error
    named: dict[str, str] = {}
    stated_units: dict[str, str | Change] = {}
    sections: dict[str, Mapping[str, Any]] = {}
    for key, known in SECTIONS.items():
        section = table.get(key, {})
        if not isinstance(section, Mapping) or (known and not {*section} <= {*known}):
            expected = f"lines of {' or '.join(known)} below [{key}]" if known else f"lines below [{key}]"
            raise RecordingError(f"{name} gives {key} = {section!r}; expected {expected}")
        sections[key] = section
    time = sections["clock"].get("time")
    columns = {**sections["columns"], **({} if time is None else {"t": time})}
    for key, value in {**table, **columns}.items():
        if key in ("joints", "units", "skip", "names", "rate", *SECTIONS):
            continue
        if key != "t" and not split(key):
            raise RecordingError(f"{name} gives {key!r}; expected t, or {'_, '.join(reversed(KINDS))}_ and a joint")
        named[key], unit = _column(name, key, value)
        stated_units |= {key: unit} if unit else {}
    for (key, column), (twin, other) in permutations(named.items(), 2):
        if column == other:
            raise RecordingError(f"{name} uses column {column!r} for both {key} and {twin}; each needs its own")
    joints, pattern = _joints(name, table.get("joints", {}))
    by_kind = {**_units(name, table.get("units", {})), **_units("--unit", units or {})}
    rate = table.get("rate", sections["clock"].get("rate"))
    stated, here = read_heading(name, table.get("skip", 0), table.get("names", ()), rate), heading or Heading()
    merged = Heading(
        here.skip or stated.skip, here.names or stated.names, stated.rate if here.rate is None else here.rate
    )
    if merged.rate == 0:
        named.pop("t", None)
    if merged.rate and "t" in named:
        raise RecordingError(f"{name} gives t, so a rate of {merged.rate:g} Hz cannot hold as well; give one of them")
    constants, gravity = sections["torque_constant"], sections["gravity"].get("vector")
    missing = sections["missing"].get("values", [])
    if not isinstance(missing, list) or not all(map(_is_number, missing)):
        raise RecordingError(f"{name} gives missing values = {missing!r}; expected a list of numbers such as [-999]")
    if wrong := next((key for key, value in constants.items() if not _is_number(value) or not value), ""):
        raise RecordingError(f"{name} gives {wrong} the torque constant {constants[wrong]!r}; expected N.m/A, not 0")
    if gravity is not None and not (isinstance(gravity, list) and len(gravity) == 3 and all(map(_is_number, gravity))):
        raise RecordingError(f"{name} gives gravity the vector {gravity!r}; expected [0, 0, -9.81] in m/s2")
    vector = None if gravity is None else tuple(gravity)
    return ParsedColumns(named, stated_units, by_kind, joints, pattern, merged, tuple(missing), constants, vector)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def read_heading(name: str, skip: object, names: object, rate: object = None) -> Heading:
    """Check the lines before a header, the names of columns, and the rate of rows [Hz], that `name` states.

    Raises:
        RecordingError: no number of lines, no list of different names, or no rate; without `name`, OptionError.
    """
    hertz = float(rate) if isinstance(rate, int | float) and not isinstance(rate, bool) else -1.0
    if rate is not None and not (hertz == 0 or MIN_HERTZ <= hertz <= MAX_HERTZ):
        expected = f"expected rows a second, {MIN_HERTZ} to {MAX_HERTZ:.0f}, or 0 where each row is a posture at rest"
        kind = RecordingError if name else OptionError
        raise kind(f"{name}{name and ': '}rate = {rate!r} is no rate of rows; {expected}")
    if not isinstance(skip, int) or isinstance(skip, bool) or not 0 <= skip <= MOST_SKIPPED:
        raise RecordingError(f"{name} gives skip = {skip!r}; expected a number of lines, 0 to {MOST_SKIPPED}")
    form = 'names = ["t", "q_1", "tau_1"]'
    if not isinstance(names, Sequence) or isinstance(names, str) or not all(isinstance(text, str) for text in names):
        raise RecordingError(f"{name} gives names = {names!r}; expected a list of names of columns, {form}")
    filled = [text.strip() for text in names]
    if len(filled) > MOST_NAMES:
        raise RecordingError(
            f"{name} gives {len(filled)} names, more than {MOST_NAMES}; name only columns of the robot"
        )
    if twice := next((text for text, count in Counter(filled).items() if text and count > 1), ""):
        raise RecordingError(f"{name} gives the name {twice!r} to two columns; give every column its own name")
    return Heading(skip, tuple(filled), None if rate is None else hertz)


def _column(name: str, key: str, value: object) -> tuple[str, str | Change]:
    """Column of a signal and its unit, "" if not stated."""
    if isinstance(value, str):
        return value, ""
    if not isinstance(value, Mapping) or not isinstance(value.get("column"), str):
        form = f'{key} = "name" or {key} = {{ column = "name", unit = "deg" }}'
        raise RecordingError(f"{name} gives {key} = {value!r}; expected the name of a column, {form}")
    if strange := [field for field in value if field not in FIELDS]:
        raise RecordingError(f"{name} has the unknown key {strange[0]!r} for {key}; expected {', '.join(FIELDS)}")
    unit, numbers = value.get("unit", ""), [value.get(field) for field in ("scale", "offset")]
    if not isinstance(unit, str) or (unit and any(number is not None for number in numbers)):
        raise RecordingError(f"{name} gives {key} the unit {unit!r}; expected a unit, or scale and offset, not both")
    if all(number is None for number in numbers):
        return value["column"], unit
    scale, offset = (default if x is None else x for x, default in zip(numbers, (1.0, 0.0), strict=True))
    if not (_is_number(scale) and _is_number(offset) and scale):
        expected = "expected numbers for value * scale + offset"
        raise RecordingError(f"{name} gives {key} an invalid scale or offset; {expected}")
    return value["column"], Change(float(scale), 1.0, float(offset))


def _units(name: str, table: object) -> dict[str, str]:
    if not isinstance(table, Mapping):
        raise RecordingError(f'{name} gives units = {table!r}; expected lines such as q = "deg" below [units]')
    for kind, unit in table.items():
        if kind not in OF or not isinstance(unit, str):
            raise RecordingError(f"{name} gives the unit {unit!r} to {kind!r}; expected {', '.join(OF)} and a unit")
        change_of(unit, kind, None, f"{name}: {kind}")
    return dict(table)


def _joints(name: str, stated: object) -> tuple[dict[str, str], tuple[str, str] | None]:
    if isinstance(stated, str) and stated.count("*") == 1:
        before, _, behind = stated.partition("*")
        return {}, (before, behind)
    if not isinstance(stated, Mapping) or not all(isinstance(token, str) for token in stated.values()):
        form = 'joints = "left_arm/*", or below [joints] lines such as elbow = "left_elbow"'
        raise RecordingError(f"{name} gives joints = {stated!r}; expected {form}")
    joints = {token: joint for joint, token in stated.items()}
    if len(joints) < len(stated):
        raise RecordingError(f"{name} gives two joints the same name of the recording; each needs its own")
    return joints, None


def revised_map(
    given: ColumnMap | None, joints: Sequence[str], columns: Mapping[str, Sequence[str]], turned: Mapping[str, Turned]
) -> str:
    """Text of a column map with other signs and zeros of revolute joints; the entries of a map given remain.

    A column keeps its kind: a current stays a current, and absolute values have no sign that could turn.

    Args:
        given: the map that the recording was read with.
        joints: of the recording.
        columns: of the recording, by kind, one for each joint, "" where a joint has none.
        turned: sign and zero by joint.

    Raises:
        RecordingError: unreadable or invalid column map, or a unit that does not fit.
    """
    parsed = read_map(given)
    entries = {key: entry(key, column, parsed.own.get(key, "")) for key, column in parsed.named.items()}
    for kind in SIGNED:
        for joint, column in zip(joints, columns.get(kind, ()), strict=False):
            if column and joint in turned and (kind in SHIFTED or turned[joint].sign < 0):
                key = next((k for k, name in parsed.named.items() if name in (column, bracketed(column)[0])), "")
                names = (key, _lower_kind(bracketed(column)[0]))
                if not any(name.startswith("abs_") for name in names):
                    current = kind == "tau" and names[1].startswith("current_")
                    key = key or f"{'current' if current else kind}_{joint}"
                    turn = turned[joint]
                    change, meaning = parsed.own.get(key, ""), split(key)[0][0]
                    unit = parsed.units.get(meaning, "") or bracketed(column)[1]
                    if not isinstance(change, Change):
                        change = (
                            change_of(change or unit, meaning, False, f"column map: {key}")
                            if change or unit
                            else Change()
                        )
                    shift = turn.zero if meaning in SHIFTED else 0.0
                    entries[key] = entry(
                        key, column, Change(turn.sign * change.scale, change.over, turn.sign * change.offset + shift)
                    )
    lines = [*heading_lines(parsed.heading), *entries.values()]
    lines += [f"joints = {quoted('*'.join(parsed.pattern))}"] if parsed.pattern else []
    tokens = {joint: token for token, joint in parsed.joints.items()}
    for title, table in (("joints", tokens), ("units", parsed.units)):
        lines += [f"\n[{title}]", *(f"{key_of(key)} = {quoted(text)}" for key, text in table.items())] if table else []
    return "\n".join(lines) + "\n"


def entry(key: str, column: str, stated: str | Change) -> str:
    """Line of a column map; own: unit, "" if none is stated, or scale and offset."""
    if isinstance(stated, Change):
        numbers = f"scale = {stated.scale / stated.over:.12g}, offset = {stated.offset:.6g}"
        return f"{key_of(key)} = {{ column = {quoted(column)}, {numbers} }}"
    unit = f", unit = {quoted(stated)}" if stated else ""
    return f"{key_of(key)} = {{ column = {quoted(column)}{unit} }}" if unit else f"{key_of(key)} = {quoted(column)}"


def heading_lines(heading: Heading) -> list[str]:
    """Lines of a column map with what a file does not say itself; none if it says all."""
    skip = [f"skip = {heading.skip}"] if heading.skip else []
    skip += [] if heading.rate is None else [f"rate = {heading.rate:g}  # [Hz]"]
    return [*skip, *([f"names = [{', '.join(map(quoted, heading.names))}]"] if heading.names else [])]


def key_of(name: str) -> str:
    """TOML key."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else quoted(name)


def quoted(text: str) -> str:
    """TOML basic string, which equals a JSON string."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


class MotorRange(NamedTuple):
    """Calibrated range of a motor [counts]."""

    low: float
    high: float

    @property
    def angle(self) -> float:
        """Size of the range [rad]."""
        return (self.high - self.low) * 2 * np.pi / COUNTS


class Calibrated(NamedTuple):
    """How recorded positions become angles around the middle of their range, and why."""

    change: Change | None  # None: the positions are degrees
    why: str


def read_calibration(path: str | Path) -> Mapping[str, MotorRange]:
    """Read the calibrated range of each motor by its name.

    Raises:
        RecordingError: unreadable file, or no calibration of LeRobot.
    """
    form = '{"shoulder_pan": {"range_min": 812, "range_max": 3310}, ...}'
    try:
        content = read_json(Path(path))
        ranges = {str(name): MotorRange(*(float(motor[key]) for key in KEYS)) for name, motor in content.items()}
    except OSError as error:
        raise RecordingError(f"calibration {path} cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise RecordingError(f"{path} is no calibration of LeRobot; expected {form}") from error
    bad = [
        name
        for name, motor in ranges.items()
        if not (np.isfinite(motor).all() and 0 < motor.high - motor.low <= COUNTS)
    ]
    if bad or not ranges:
        fault = f"has no valid range of {shorten(bad)}" if bad else "names no motor"
        raise RecordingError(f"{path} {fault}; expected {form} with 0 < range_max - range_min <= {COUNTS}")
    return ranges


def calibrated(values: Mapping[str, Array], ranges: Mapping[str, MotorRange]) -> dict[str, Calibrated]:
    """Conversion of the positions of the motors that have a range; values: (N,) [% or deg] by name of the motor.

    Positions of one motor beyond 100 are degrees, and so are those of all but grippers; positions of one motor beyond
    the half of its range in degrees are per cent. A gripper has 0 to 100 %.
    """
    ends = {name: (float(np.nanmin(x, initial=0.0)), float(np.nanmax(x, initial=0.0))) for name, x in values.items()}
    grippers = {name for name, (low, _) in ends.items() if "gripper" in name.lower() and low >= -PERCENT_ROUNDING}
    reach = {name: max(-low, high) for name, (low, high) in ends.items() if name in ranges and name not in grippers}
    degrees = any(size > PERCENT + PERCENT_ROUNDING for size in reach.values())
    sure = any(size > np.degrees(ranges[name].angle) / 2 + PERCENT_ROUNDING for name, size in reach.items())
    conversions: dict[str, Calibrated] = {}
    for name in values:
        if name not in ranges:
            continue
        angle = ranges[name].angle
        whole = f"{np.degrees(angle):.4g} degrees, the range in the calibration file"
        if name in grippers:
            change = Change(angle / PERCENT, 1.0, -angle / 2)
            conversions[name] = Calibrated(change, f"0 to 100 % of {whole}; zero in its middle is assumed: CHECK")
        elif degrees:
            conversions[name] = Calibrated(None, "one joint goes beyond 100, so these are degrees")
        else:
            caveat = "" if sure else "; these may be degrees: CHECK"
            conversions[name] = Calibrated(Change(angle / (2 * PERCENT)), f"-100 to 100 % of {whole}{caveat}")
    return conversions
