"""Which column is which signal of which joint."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

from ..errors import RecordingError, shorten
from ..types import Robot, Table
from .formats.base import About
from .mapping import ColumnMap, Columns, Signal, read_map, split
from .names import suggest
from .numbering import doubt_numbers
from .source import Opened
from .units import Change, Changed

TORQUES = ("tau", "current", "abs_tau", "abs_current")  # the first that a joint has is used
CLOSE = 0.7  # similarity of names that is taken for a slip of the pen


@dataclass(frozen=True)
class Assignment:
    """Signals by kind and joint ("t" by joint 0), what was noticed on the way, and the table in the right units."""

    signals: Mapping[tuple[str, int], Signal]
    notes: tuple[str, ...]
    table: Table
    flags: tuple[str, ...] = ()  # sentences on columns whose joint is doubtful

    def column(self, kind: str, joint: int) -> str:
        """The column of a signal, "" where the source has none."""
        signal = self.signals.get((kind, joint))
        return signal.column if signal else ""

    def torque(self, joint: int) -> str:
        """The kind of torque that is used for a joint, "" where there is none."""
        return next((kind for kind in TORQUES if (kind, joint) in self.signals), "")


def assign_columns(opened: Opened, given: ColumnMap | None, robot: Robot) -> Assignment:
    """Every column that is a signal of a joint; others are left alone.

    A joint is called by its name or, where no joint has that name, by its number. A column that looks like a signal
    of an unknown joint is an error where a joint of the robot still lacks that signal, else it is only noted.

    Raises:
        RecordingError: the map cannot be read, names what is not there, a column names no joint or one twice, or the
            unit of a column is open or none of its kind.
    """
    source, columns = opened.name, read_map(given)
    signals: dict[tuple[str, int], Signal] = {}
    strangers = []
    for signal in columns.signals(opened.table.columns, source):
        key = ("t", 0) if signal.logical == "t" else resolve(signal.logical, robot)
        if key is None:
            strangers.append(signal)
        elif key[1] >= 0:
            rival = signals.get(key, signal)
            if rival is not signal and rival.mapped == signal.mapped:
                names = f"{rival.logical} and {signal.logical}"
                raise RecordingError(f"{source} has {names}, which are the same signal of one joint; keep one of them")
            signals[key] = signal if signal.mapped else rival
    notes = _ignored(strangers, signals, robot, opened)
    numbered = [j for (kind, j), signal in signals.items() if kind == "q" and _is_number(signal, robot)]
    flags = doubt_numbers(source, robot, numbered)
    return Assignment(signals, notes, _in_units(opened, columns, signals, robot), flags)


def _is_number(signal: Signal, robot: Robot) -> bool:
    """Whether a column of the source names its joint by a number that nobody put there on purpose."""
    return not signal.mapped and not any(token in robot.joints for _, token in split(signal.logical))


def _in_units(opened: Opened, columns: Columns, signals: Mapping[tuple[str, int], Signal], robot: Robot) -> Table:
    """The table with the columns of signals in the units of recordings."""
    changes: dict[str, Change] = {}
    for (kind, joint), signal in signals.items():
        change = columns.change(signal, kind, None if kind == "t" else bool(robot.prismatic[joint]), opened.name)
        if change is not None:
            changes[signal.column] = change
        elif signal.column in About.of(opened.table).unstated:
            raise RecordingError(unstated(opened.name, signal.column, kind))
    return Changed(opened.table, changes) if changes else opened.table


def unstated(source: str, column: str, kind: str) -> str:
    """The sentence about a column whose unit nobody stated."""
    usual = {"q": "deg, or rad", "q_des": "deg, or rad", "tau": "N.m", "current": "mA"}.get(kind, "rad/s")
    ask = f'state it, {kind} = "..." below [units] in a column map (--columns), or signid convert --unit {kind}=...'
    return f"{source} does not say in which unit column {column!r} is ({usual}, or else); {ask}"


def resolve(logical: str, robot: Robot) -> tuple[str, int] | None:
    """Kind and joint of a name; joint -1 for what is no signal or belongs to a held joint; None when nobody knows."""
    pairs = split(logical)
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
    strangers: Iterable[Signal], signals: Mapping[tuple[str, int], Signal], robot: Robot, opened: Opened
) -> tuple[str, ...]:
    """A note of the signals of unknown joints that are not needed.

    "q_motor_1" is another quantity of joint 1, and is passed over in silence.
    """
    ignored = []
    for signal in strangers:
        kind, token = split(signal.logical)[0]
        same = TORQUES if kind in TORQUES else (kind,)
        lacking = [name for j, name in enumerate(robot.joints) if not any((k, j) in signals for k in same)]
        lower = {name.lower(): name for name in reversed(robot.joints if signal.mapped else lacking)}
        close = get_close_matches(token.lower(), lower, 1, CLOSE)
        quantity = any(resolve(f"q_{token[i + 1 :]}", robot) for i, letter in enumerate(token) if letter == "_" and i)
        if signal.mapped or (lacking and (close or token.isdecimal() or (kind == "q" and not quantity))):
            guess = f" (perhaps {lower[close[0]]} is meant)" if close else ""
            joints = f"{shorten(robot.joints, 12)}, numbered {_range(robot.numbers)}"
            told = f"{opened.name}: {signal.logical} names no joint of {robot.name}{guess}; it has {joints}"
            raise RecordingError(told + suggest(opened.table.columns, robot))
        if token.isdecimal() or (kind == "q" and not quantity):
            ignored.append(signal.column)
    return (f"ignored, because {robot.name} has no such joint: {shorten(ignored, 12)}",) if ignored else ()


def _range(numbers: Sequence[int]) -> str:
    whole = tuple(range(numbers[0], numbers[-1] + 1)) == tuple(numbers)
    return f"{numbers[0]} to {numbers[-1]}" if whole else ", ".join(map(str, numbers))
