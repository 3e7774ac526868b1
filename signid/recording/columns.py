"""Which column is which signal of which joint."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import NamedTuple

from ..errors import RecordingError
from ..plain import read_toml
from ..types import Robot

TORQUES = ("tau", "current", "abs_tau", "abs_current")  # the first that a joint has is used
KINDS = ("abs_current", "abs_tau", "current", "q_des", "ddq", "dq", "tau", "q")  # longer prefixes first
CLOSE = 0.7  # similarity of names that is taken for a slip of the pen

ColumnMap = str | Path | Mapping[str, str]


class Signal(NamedTuple):
    """A column of the source and what it stands for."""

    logical: str  # "q_elbow"
    column: str  # "elbow_pos"
    mapped: bool


class Assignment(NamedTuple):
    """Signals by kind and joint ("t" by joint 0), and what was noticed on the way."""

    signals: Mapping[tuple[str, int], Signal]
    notes: tuple[str, ...]

    def column(self, kind: str, joint: int) -> str:
        """The column of a signal, "" where the source has none."""
        signal = self.signals.get((kind, joint))
        return signal.column if signal else ""

    def torque(self, joint: int) -> str:
        """The kind of torque that is used for a joint, "" where there is none."""
        return next((kind for kind in TORQUES if (kind, joint) in self.signals), "")


def assign_columns(columns: Sequence[str], given: ColumnMap | None, robot: Robot, source: str) -> Assignment:
    """Every column that is a signal of a joint; others are left alone.

    A joint is called by its name or, where no joint has that name, by its number. A column that looks like a signal
    of an unknown joint is an error where a joint of the robot still lacks that signal, else it is only noted.

    Raises:
        RecordingError: the map cannot be read, names what is not there, or a column names no joint or one twice.
    """
    signals: dict[tuple[str, int], Signal] = {}
    strangers = []
    for signal in _named(columns, _read_map(given), source):
        key = ("t", 0) if signal.logical == "t" else _resolve(signal.logical, robot)
        if key is None:
            strangers.append(signal)
        elif key[1] >= 0:
            rival = signals.get(key, signal)
            if rival is not signal and rival.mapped == signal.mapped:
                names = f"{rival.logical} and {signal.logical}"
                raise RecordingError(f"{source} has {names}, which are the same signal of one joint; keep one of them")
            signals[key] = signal if signal.mapped else rival
    return Assignment(signals, _ignored(strangers, signals, robot, source))


def _read_map(given: ColumnMap | None) -> Mapping[str, str]:
    if given is None:
        return {}
    name, table = "the column map", given
    if not isinstance(given, Mapping):
        name = f"column map {given}"
        try:
            table = read_toml(given)
        except OSError as error:
            raise RecordingError(f"{name} cannot be read: {error.strerror}") from error
        except ValueError as error:
            raise RecordingError(f'{name} is not TOML such as q_elbow = "elbow_pos": {error}') from error
    assert isinstance(table, Mapping)
    for key, value in table.items():
        if not isinstance(value, str):
            raise RecordingError(f'{name} gives {key} = {value!r}; expected the name of a column, {key} = "name"')
        if key != "t" and not _kinds(key):
            raise RecordingError(f"{name} gives {key!r}; expected t, or {'_, '.join(reversed(KINDS))}_ and a joint")
        if twin := next((k for k, v in table.items() if v == value and k != key), None):
            raise RecordingError(f"{name} uses column {value!r} for both {key} and {twin}; each needs its own")
    return table


def _named(columns: Sequence[str], table: Mapping[str, str], source: str) -> Iterator[Signal]:
    """Columns under the names that the map gives them; one that the map takes no longer stands for its own name."""
    for key, column in table.items():
        if column not in columns:
            raise RecordingError(f"{source} has no column {column!r} for {key}; it has {_list(columns)}")
        yield Signal(key, column, True)
    taken = {*table, *table.values()}
    yield from (Signal(name, name, False) for name in columns if name not in taken)


def _kinds(logical: str) -> list[tuple[str, str]]:
    """The kinds and joints that a name may be made of, the longest kind first."""
    return [(kind, logical[len(kind) + 1 :]) for kind in KINDS if logical.startswith(kind + "_")]


def _resolve(logical: str, robot: Robot) -> tuple[str, int] | None:
    """Kind and joint of a name; joint -1 for what is no signal or belongs to a held joint; None when nobody knows."""
    pairs = _kinds(logical)
    for kind, token in pairs:
        if token in robot.joints:
            return kind, robot.joints.index(token)
        if token.isdecimal() and int(token) in robot.numbers:
            return kind, robot.numbers.index(int(token))
    return None if pairs and not any(_is_held(token, robot) for _, token in pairs) else ("", -1)


def _is_held(token: str, robot: Robot) -> bool:
    """Whether the description has such a joint, but it does not move by itself."""
    names = [] if robot.model is None else list(robot.model.names)[1:]
    return token in names or (token.isdecimal() and 0 < int(token) <= max(len(names), *robot.numbers))


def _ignored(
    strangers: Iterable[Signal], signals: Mapping[tuple[str, int], Signal], robot: Robot, source: str
) -> tuple[str, ...]:
    """A note of the signals of unknown joints that are not needed.

    "q_motor_1" is another quantity of joint 1, and is passed over in silence.
    """
    ignored = []
    for signal in strangers:
        kind, token = _kinds(signal.logical)[0]
        same = TORQUES if kind in TORQUES else (kind,)
        lacking = [name for j, name in enumerate(robot.joints) if not any((k, j) in signals for k in same)]
        lower = {name.lower(): name for name in reversed(robot.joints if signal.mapped else lacking)}
        close = get_close_matches(token.lower(), lower, 1, CLOSE)
        quantity = any(_resolve(f"q_{token[i + 1 :]}", robot) for i, letter in enumerate(token) if letter == "_" and i)
        if signal.mapped or (lacking and (close or token.isdecimal() or (kind == "q" and not quantity))):
            guess = f" (perhaps {lower[close[0]]} is meant)" if close else ""
            joints = f"{_list(robot.joints)}, numbered {_range(robot.numbers)}"
            raise RecordingError(f"{source}: {signal.logical} names no joint of {robot.name}{guess}; it has {joints}")
        if token.isdecimal() or (kind == "q" and not quantity):
            ignored.append(signal.column)
    return (f"ignored, because {robot.name} has no such joint: {_list(ignored)}",) if ignored else ()


def _list(names: Sequence[str]) -> str:
    return f"{', '.join(names[:12])}{', ...' if len(names) > 12 else ''}"


def _range(numbers: Sequence[int]) -> str:
    whole = tuple(range(numbers[0], numbers[-1] + 1)) == tuple(numbers)
    return f"{numbers[0]} to {numbers[-1]}" if whole else ", ".join(map(str, numbers))
