"""Columns of a table as signals of joints, in the units of recordings."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches

import numpy as np

from ..errors import RecordingError, shorten
from ..types import Array, Robot, ServoSamples, StatedUnit, Table
from .formats.base import About
from .names.mapping import TORQUES, DerivedTable, ParsedColumns, Signal, split
from .names.match import last_numbers
from .names.vocabulary import Change, change_of, signed_register
from .source import Opened
from .units import UNSTATED

WHEEL = re.compile(r"wheel|caster|castor|rotor|propeller", re.IGNORECASE)
FINGER = re.compile(r"finger|thumb|gripper|jaw|hand", re.IGNORECASE)
LONG = 150  # maximum length of a map within a message [characters]
ARM = "arm joint"  # a revolute joint that is no wheel and no finger
DIGITS = 10  # of numbers of joints, fewer than these
MIN_NAME_SIMILARITY = 0.7  # minimum similarity of names (difflib) for a suggestion [1]


@dataclass(frozen=True)
class Assignment:
    """Signals by kind and joint ("t" by joint 0), notes and flags, and the table in the units of recordings."""

    signals: Mapping[tuple[str, int], Signal]
    notes: tuple[str, ...]
    table: Table
    flags: tuple[str, ...] = ()  # columns with an uncertain joint, one sentence each
    units: Mapping[str, StatedUnit] = field(default_factory=dict)  # by column

    def column(self, kind: str, joint: int) -> str:
        """Column of a signal, "" if there is none."""
        signal = self.signals.get((kind, joint))
        return signal.column if signal else ""

    def torque(self, joint: int) -> str:
        """Kind of the torque column used for a joint, "" if there is none."""
        return next((kind for kind in TORQUES if (kind, joint) in self.signals), "")


def assign_columns(opened: Opened, columns: ParsedColumns, robot: Robot) -> Assignment:
    """Assign all columns that are signals of joints; other columns are ignored.

    A column names its joint by name or, if no joint has that name, by number. A column of an unknown joint is an error
    if a joint of the robot lacks that signal; otherwise it is noted.

    Raises:
        RecordingError: invalid column map, missing column, unknown joint, duplicate signal, or missing or wrong unit.
    """
    source = opened.name
    signals: dict[tuple[str, int], Signal] = {}
    unassigned = []
    for signal in columns.signals(opened.table.columns, source):
        key = ("t", 0) if signal.logical == "t" else resolve(signal.logical, robot)
        if key is None:
            unassigned.append(signal)
        elif key[1] >= 0:
            rival = signals.get(key, signal)
            if rival is not signal and rival.mapped == signal.mapped:
                both = (rival.logical, signal.logical)
                names = " and ".join(both if both[0] != both[1] else (rival.column, signal.column))
                raise RecordingError(f"{source} has {names}, which are the same signal of one joint; keep one of them")
            signals[key] = signal if signal.mapped else rival
    units = stated_units(columns, ((kind, signal) for (kind, _), signal in signals.items()))
    ignored, strange = _ignored(unassigned, signals, robot, opened, bool(columns.named))
    notes = (*ignored, *unit_caveats(opened, units))
    numbered = [
        j
        for (kind, j), signal in signals.items()
        if kind == "q" and not signal.mapped and not any(token in robot.joints for _, token in split(signal.logical))
    ]
    flags = (*strange, *_uncertain(source, robot, numbered))
    found = [
        (kind, signal, None if kind == "t" else bool(robot.prismatic[joint]))
        for (kind, joint), signal in signals.items()
    ]
    return Assignment(signals, notes, converted(opened, columns, found), flags, units)


def converted(
    opened: Opened, columns: ParsedColumns, signals: Collection[tuple[str, Signal, bool | None]], strict: bool = True
) -> Table:
    """The table with columns of signals in the units of recordings; each with its kind, and whether its joint slides.

    Unless `strict`, columns without a stated unit are left in theirs.

    Raises:
        RecordingError: a unit is not stated, or does not fit the column.
    """
    changes = {}
    for kind, signal, prismatic in signals:
        if change := function(kind, conversion(opened, columns, signal, kind, prismatic, strict=strict)):
            changes[signal.column] = change
    names, missing = {signal.column for _, signal, _ in signals}, columns.missing
    absent = dict.fromkeys(names, lambda x, _: np.where(np.isin(x, missing), np.nan, x)) if missing else {}
    known = DerivedTable(opened.table, absent) if missing else opened.table
    return DerivedTable(known, changes) if changes else known


def stated_units(columns: ParsedColumns, signals: Iterable[tuple[str, Signal]]) -> dict[str, StatedUnit]:
    """Units by column of signals and their kinds, where a column map or the name of the column states one."""
    found = {}
    for kind, signal in signals:
        own = columns.own.get(signal.logical, "") if signal.mapped else ""
        if by_map := str(own) or columns.units.get(kind, ""):
            found[signal.column] = StatedUnit(by_map, "the column map")
        elif signal.unit:
            found[signal.column] = StatedUnit(signal.unit, "its name")
    return found


def unit_caveats(opened: Opened, units: Mapping[str, StatedUnit]) -> tuple[str, ...]:
    """A note on units of positions that a column map states for a source that may hold per cent instead."""
    unstated = About.of(opened.table).unstated
    angles = {units[name].unit for name in unstated & units.keys() if units[name].unit in ("deg", "rad")}
    return tuple(f"positions are in {unit} by the column map: {UNSTATED}" for unit in sorted(angles))


def conversion(
    opened: Opened, columns: ParsedColumns, signal: Signal, kind: str, prismatic: bool | None, *, strict: bool
) -> Change | None:
    """Conversion of a column to the unit of recordings; None if it has that unit.

    Raises:
        RecordingError: the unit is not stated, or does not fit the column.
    """
    own = columns.own.get(signal.logical) if signal.mapped else None
    if isinstance(own, Change):
        return own
    if unit := own or columns.units.get(kind) or signal.unit:
        return change_of(unit, kind, prismatic, f"{opened.name}: column {signal.column!r}")
    if not strict or signal.column not in About.of(opened.table).unstated:
        return None
    typical = {
        "q": "deg, or rad",
        "q_des": "deg, or rad",
        "tau": "N.m",
        "current": "mA",
        "volt": "V",
        "temp": "C",
        "pwm": "%",
    }.get(kind, "rad/s")
    fault, unit = f"does not state the unit of column {signal.column!r} (such as {typical})", typical.partition(",")[0]
    advice = f'write [units] {kind} = "{unit}", on two lines, into a column map (--columns)'
    raise RecordingError(f"{opened.name} {fault}; {advice}, or state it by signid convert --unit {kind}={unit}")


def function(kind: str, change: Change | None) -> Callable[[Array, int], Array] | None:
    """Conversion of a column (N,) as recorded to the values of a recording; None if they are the same."""
    if kind != "pwm":
        return change.apply if change else None
    convert = change or Change()
    return lambda values, start: convert.apply(signed_register(values))


def resolve(logical: str, robot: Robot) -> tuple[str, int] | None:
    """Kind and joint of a name; joint -1 if it is no signal or of a held joint; None if the joint is unknown."""
    pairs = split(logical)
    for kind, token in pairs:
        if token in robot.joints:
            return kind, robot.joints.index(token)
        if token.isdecimal() and len(token) < DIGITS and int(token) in robot.numbers:
            return kind, robot.numbers.index(int(token))
    names = [] if robot.model is None else list(robot.model.names)[1:]
    most = max(len(names), *robot.numbers)
    numbers = (int(token) for _, token in pairs if token.isdecimal() and len(token) < DIGITS)
    held = any(token in names for _, token in pairs) or any(0 < number <= most for number in numbers)
    return None if pairs and not held else ("", -1)


def _ignored(
    unassigned: Iterable[Signal], signals: Mapping[tuple[str, int], Signal], robot: Robot, opened: Opened, mapped: bool
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Notes and flags on ignored signals of unknown joints; names like "q_motor_1" are quantities.

    If a joint lacks such a signal, it is refused; or flagged, if a column map names columns.

    Raises:
        RecordingError: a signal of an unknown joint that a joint lacks.
    """
    ignored, strange = list[str](), list[str]()
    for signal in unassigned:
        kind, token = split(signal.logical)[0]
        if kind in ServoSamples._fields and not signal.mapped:
            continue
        same = TORQUES if kind in TORQUES else (kind,)
        lacking = [name for j, name in enumerate(robot.joints) if not any((k, j) in signals for k in same)]
        lower = {name.lower(): name for name in reversed(robot.joints if signal.mapped else lacking)}
        close = get_close_matches(token.lower(), lower, 1, MIN_NAME_SIMILARITY)
        quantity = any(resolve(f"q_{token[i + 1 :]}", robot) for i, letter in enumerate(token) if letter == "_" and i)
        missed = bool(lacking and (close or token.isdecimal() or (kind == "q" and not quantity)))
        if missed and mapped and not signal.mapped:
            strange.append(signal.column)
        elif signal.mapped or missed:
            guess = f" (perhaps {lower[close[0]]} is meant)" if close else ""
            first, last = robot.numbers[0], robot.numbers[-1]
            whole = robot.numbers == tuple(range(first, last + 1))
            numbers = f"{first} to {last}" if whole else ", ".join(map(str, robot.numbers))
            joints = f"{shorten(robot.joints, 12)}, numbered {numbers}"
            fault = f"{opened.name}: {signal.logical} names no joint of {robot.name}{guess}; it has {joints}"
            raise RecordingError(fault)
        elif token.isdecimal() or (kind == "q" and not quantity):
            ignored.append(signal.column)
    notes = (f"ignored, because {robot.name} has no such joint: {shorten(ignored, 12)}",) if ignored else ()
    flags = (unknown_joints_flag(opened.name, robot, strange, "ignored"),) if strange else ()
    return notes, flags


def unknown_joints_flag(source: str, robot: Robot, columns: Sequence[str], done: str) -> str:
    """Flag on columns of joints that the robot does not have, beside a column map; done: what became of them."""
    fact = f"{source}: {done}, because {robot.name} has no such joint: {shorten(columns, 6)}"
    return f"{fact}; name those that its joints lack in the column map"


def _uncertain(source: str, robot: Robot, joints: Sequence[int]) -> tuple[str, ...]:
    """Flag joint numbers that may not follow the order of the description, or reject numbers of several kinds of joint.

    Numbers are certain if every moving joint has one, if they match digits in the joint names (3 in panda_joint3), or
    if no other chain of arm joints has the same length.
    """
    joints = sorted(joints, key=lambda j: robot.numbers[j])
    numbers = [robot.numbers[j] for j in joints]
    if robot.model is None or len(joints) in (0, 1, len(robot.joints)) or _digits(robot, joints) == numbers:
        return ()
    parents = _parents(robot)
    rivals = [rival for rival in _chains(robot, parents, len(joints)) if set(rival) != set(joints)]
    kinds = {_kind(robot, parents, j) for j in joints}
    if not rivals or (kinds == {ARM} and _is_chain(joints, parents)):
        return ()
    rival = max(rivals, key=lambda r: _digits(robot, r) == numbers)
    names = [robot.joints[j] for j in rival]
    lines = [f'{name} = "{number}"' for name, number in zip(names, numbers, strict=True)]
    whole = f"joints = {{ {', '.join(lines)} }}"
    meant = whole if len(whole) <= LONG else f"below [joints] {lines[0]}, {lines[1]} to {lines[-1]}, a line each"
    sentence = (
        f"{source}: in the order of the description, columns {numbers[0]} to {numbers[-1]} belong to "
        f"{shorten([robot.joints[j] for j in joints], 3)}, but {names[0]} to {names[-1]} may be meant; "
        f"state the joints in a column map (--columns): {meant}"
    )
    if len(kinds) > 1:
        raise RecordingError(sentence)
    return (sentence,)


def _digits(robot: Robot, joints: Sequence[int]) -> list[int]:
    """Last number in each joint name, 0 if there is none."""
    found = last_numbers(robot)
    return [found[j] or 0 for j in joints]


def _parents(robot: Robot) -> list[list[int]]:
    """Ancestors of each joint, nearest last."""
    ids = [robot.model.getJointId(name) for name in robot.joints]
    return [[ids.index(k) for k in list(robot.model.supports[i])[:-1] if k in ids] for i in ids]


def _kind(robot: Robot, parents: Sequence[Sequence[int]], joint: int) -> str:
    """Kind of a joint: wheel, finger, slide or arm joint."""
    name = robot.joints[joint]
    alone = not parents[joint] and not any(joint in above for above in parents)
    if WHEEL.search(name) or (alone and not np.isfinite(robot.lower[joint]) and not robot.prismatic[joint]):
        return "wheel"
    if FINGER.search(name):
        return "finger"
    return "slide" if robot.prismatic[joint] else ARM


def _is_chain(joints: Sequence[int], parents: Sequence[Sequence[int]]) -> bool:
    """Whether the joints form a serial chain."""
    order = sorted(joints, key=lambda j: len(parents[j]))
    return all(set(order[:k]) <= set(parents[j]) for k, j in enumerate(order))


def _chains(robot: Robot, parents: Sequence[Sequence[int]], count: int) -> Iterator[tuple[int, ...]]:
    """Serial chains of `count` arm joints that are consecutive in the description."""
    for start in range(len(robot.joints) - count + 1):
        run = tuple(range(start, start + count))
        if _is_chain(run, parents) and all(_kind(robot, parents, j) == ARM for j in run):
            yield run
