"""Columns of a table as signals of joints, in the units of recordings, which names and numbers may show."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import NamedTuple

import numpy as np

from ..errors import RecordingError, shorten
from ..types import Array, Robot, ServoSamples, StatedUnit, Table
from .formats.base import About
from .mapping import TORQUES, DerivedTable, ParsedColumns, Signal, split
from .match import Guess, last_numbers
from .sampling.clock import MAX_STEP, MIN_STEP
from .source import Opened
from .vocabulary import OF, TURN, Change, Units, change_of, signed_register

WHEEL = re.compile(r"wheel|caster|castor|rotor|propeller", re.IGNORECASE)
FINGER = re.compile(r"finger|thumb|gripper|jaw|hand", re.IGNORECASE)
LONG = 150  # maximum length of a map within a message [characters]
ARM = "arm joint"  # a revolute joint that is no wheel and no finger
DIGITS = 10  # of numbers of joints, fewer than these
MIN_NAME_SIMILARITY = 0.7  # minimum similarity of names (difflib) for a suggestion [1]
EPOCH = 1.0e9, 2.5e9  # [s] time stamps since 1970 of the years 2001 to 2049
LIMIT_MARGIN = {False: 0.35, True: 0.02}  # [rad], [m] accepted distance beyond limits, by whether a joint is prismatic
FREE = {False: 60.0, True: 10.0}  # [rad], [m] largest plausible position without limits
Q_UNITS = {False: ("rad", "deg", "mrad"), True: ("m", "mm", "um")}  # units of positions, the most usual first
COUNTS = 400.0  # smallest size of whole numbers that are counts of an encoder [1]
TURNS = (1024, 4096, 16384, 65536)  # usual counts of a turn
DRIFT = 0.1  # [s] intervals over which velocity is compared with position
MAX_LOG_RATIO = 0.3  # largest logarithm of the ratio of both for a unit
STRONG = 20.0  # torque over the limit of the description beyond which the unit is smaller than N.m
DUTY, REGISTERS = 1.01, (100.0, 885.0, 1000.0, 1023.0)  # largest duty; registers of a full one: %, XL330, STS, AX
UNIT_LIMITS = {  # [V], [A] beyond which numbers are in a smaller unit
    "volt": (("mV", 1000.0), ("dV", 60.0)),
    "current": (("mA", 60.0),),
}
LOAD = "a load may be in per mille of the largest torque"
PERCENT = "the names state per cent; write scale = rated torque / 100"
NAMELESS = "no name states that these are positions"
UNSTATED = (
    "LeRobot datasets do not say whether numbers are degrees or per cent of the calibrated range, and a gripper's are "
    "0 to 100 % in any case; give the calibration file (--calibration), or write scale and offset"
)


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
    assigned = [
        (kind, signal, None if kind == "t" else bool(robot.prismatic[joint]))
        for (kind, joint), signal in signals.items()
    ]
    return Assignment(signals, notes, converted(opened, columns, assigned), flags, units)


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
    units = {}
    for kind, signal in signals:
        stated = columns.own.get(signal.logical, "") if signal.mapped else ""
        if by_map := str(stated) or columns.units.get(kind, ""):
            units[signal.column] = StatedUnit(by_map, "the column map")
        elif signal.unit:
            units[signal.column] = StatedUnit(signal.unit, "its name")
    return units


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
    stated = columns.own.get(signal.logical) if signal.mapped else None
    if isinstance(stated, Change):
        return stated
    if unit := stated or columns.units.get(kind) or signal.unit:
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
    highest = max(len(names), *robot.numbers)
    numbers = (int(token) for _, token in pairs if token.isdecimal() and len(token) < DIGITS)
    held = any(token in names for _, token in pairs) or any(0 < number <= highest for number in numbers)
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
    ids = [robot.model.getJointId(name) for name in robot.joints]
    parents = [[ids.index(k) for k in list(robot.model.supports[i])[:-1] if k in ids] for i in ids]  # nearest last
    chains: list[tuple[int, ...]] = []
    count = len(joints)
    for start in range(len(robot.joints) - count + 1):
        run = tuple(range(start, start + count))
        if _is_chain(run, parents) and all(_kind(robot, parents, j) == ARM for j in run):
            chains.append(run)
    rivals = [rival for rival in chains if set(rival) != set(joints)]
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
    numbers = last_numbers(robot)
    return [numbers[j] or 0 for j in joints]


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


class Noticed(NamedTuple):
    """Unit of a column, or its scale and offset, and why."""

    unit: str | Change
    why: str

    def with_caveat(
        self, nameless: bool = False, percent: bool = False, load: bool = False, unstated: bool = False
    ) -> Noticed:
        """The same unit, with the first caveat that holds, for the user to check."""
        caveats = {UNSTATED: unstated, NAMELESS: nameless, PERCENT: percent, LOAD: load}
        caveat = next((text for text, holds in caveats.items() if holds), "")
        return Noticed(self.unit, f"{self.why}; {caveat}: CHECK") if caveat else self


def time_unit(t: Array, named: str) -> Noticed:
    """Unit of time stamps t (N,) [any unit]; `named` is the unit in the name of the column, "" without one."""
    known = t[np.isfinite(t)]
    steps = np.diff(known)
    steps = steps[steps > 0]
    if named or not len(steps):
        return Noticed(named or "s", "named in the column" if named else "assumed")
    step, last = float(np.median(steps)), float(np.abs(known).max())
    for unit, (scale, over) in OF["t"][0].items():
        if EPOCH[0] <= last * scale / over <= EPOCH[1] and MIN_STEP <= step * scale / over <= MAX_STEP:
            since = "" if unit == "s" else f" of {unit}"
            return Noticed(unit, f"begins at {known[0]:.10g}: a count{since} since 1970, in steps of {step:.4g}")
    whole = step >= 0.5 and bool(np.all(np.abs(known - np.rint(known)) < 1e-6))
    if MIN_STEP <= step <= MAX_STEP and not whole:
        return Noticed("s", f"steps by {step:.4g}")
    likely = next((unit for unit, limit in (("ms", 500.0), ("us", 5e5), ("ns", np.inf)) if step <= limit), "ns")
    return Noticed(likely, f"steps by {step:.4g}, which cannot be seconds")


def _position_units(
    values: Mapping[int, Array], named: Mapping[int, str], counts: bool, robot: Robot
) -> dict[int, Noticed]:
    """Units of position columns by index of the joint; `counts`: they are named as counts.

    values: (N,) [any unit] of each joint.
    """
    noticed: dict[int, Noticed] = {}
    for slides, units in ((False, OF["q"][0]), (True, OF["q"][1])):
        columns = {j: x[np.isfinite(x)] for j, x in values.items() if bool(robot.prismatic[j]) == slides}
        ends = {j: (float(x.min()), float(x.max())) for j, x in columns.items() if len(x)}
        whole = all(bool(np.all(x == np.rint(x))) for x in columns.values())
        largest = max((abs(end) for both in ends.values() for end in both), default=0.0)
        if ends and whole and not slides and not any(named.get(j) for j in columns) and (counts or largest > COUNTS):
            low, high = min(a for a, _ in ends.values()), max(b for _, b in ends.values())
            turn = next((n for n in TURNS if low >= 0 and high < n), 0)  # half of it is zero if all counts are of one
            size, zero = turn or 4096, f"zero at {turn // 2}"
            change = Change(2 * np.pi / size, 1.0, -np.pi if turn else 0.0)
            why = f"whole numbers from {low:.0f} to {high:.0f}: encoder counts; {size} a turn and {zero} are assumed"
            noticed |= dict.fromkeys(ends, Noticed(change, f"{why}, CHECK"))
            continue
        base = next(iter(units))
        unit = next((unit for unit in Q_UNITS[slides] if _fits(ends, units[unit], slides, robot)), "")
        worst = max(ends, key=lambda j: max(ends[j][1] - robot.upper[j], robot.lower[j] - ends[j][0]), default=-1)
        why = "the column has no values"
        if ends:
            limits = f"its limits are {robot.lower[worst]:.4g} to {robot.upper[worst]:.4g} {base}"
            why = f"{robot.joints[worst]} goes from {ends[worst][0]:.4g} to {ends[worst][1]:.4g}, {limits}"
        for j in columns:
            stated = named.get(j, "")
            caveat = "; assumed" if unit == base else "" if unit else "; no usual unit fits: CHECK"
            noticed[j] = Noticed(stated, "named in the column") if stated else Noticed(unit or base, why + caveat)
    return noticed


def _fits(ends: Mapping[int, tuple[float, float]], factor: tuple[float, float], slides: bool, robot: Robot) -> bool:
    """Whether positions between their ends [any unit] are within the limits of their joints."""
    scale, slack = factor[0] / factor[1], LIMIT_MARGIN[slides]
    for j, (low, high) in ends.items():
        lower, upper = robot.lower[j], robot.upper[j]
        if not (np.isfinite(lower) and np.isfinite(upper) and lower < upper):
            lower, upper = -FREE[slides], FREE[slides]
        if low * scale < lower - slack or high * scale > upper + slack:
            return False
    return True


def _velocity_unit(pairs: Sequence[tuple[Array, Array]], t: Array, slides: bool) -> Noticed:
    """Unit of velocities from pairs of positions (N,) [rad or m] and velocities (N,) [any unit] at t (N,) [s]."""
    units: Units = OF["dq"][slides]
    base, up, down = next(iter(units)), 0.0, 0.0
    period = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    step = max(1, round(DRIFT / period)) if period > 0 else 1
    for q, v in pairs:
        moved = q[step::step] - q[:-step:step]
        area = np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2 * np.diff(t))])
        swept = area[step::step] - area[:-step:step]
        known = np.isfinite(moved) & np.isfinite(swept)
        up, down = up + float(moved[known] @ swept[known]), down + float(swept[known] @ swept[known])
    if up <= 0 or down <= 0:
        return Noticed(base, "assumed")
    ratio = up / down
    off = {unit: abs(float(np.log(ratio * over / scale))) for unit, (scale, over) in units.items()}
    best = min(off, key=lambda unit: off[unit])
    if off[best] > MAX_LOG_RATIO:
        return Noticed(base, f"positions change by {ratio:.3g} of it, which fits no usual unit: CHECK")
    return Noticed(best, f"positions change by {ratio:.3g} of it")


def _most(x: Array) -> float:
    return float(np.nanmax(np.abs(x), initial=0.0))


def noticed_units(
    kind: str,
    guesses: Mapping[int, Guess],
    columns: Mapping[int, Array],
    positions: Mapping[int, Array],
    seconds: Array,
    robot: Robot,
) -> dict[int, Noticed]:
    """Unit of each column of a kind, by index of the joint.

    columns: (N,) [any unit] of each joint; positions: (N,) [rad or m] of those that have them, at seconds (N,) [s].
    """
    if kind in ("q", "q_des"):
        counts = any(guess.counts for guess in guesses.values())
        units = _position_units(columns, {j: guess.unit for j, guess in guesses.items()}, counts, robot)
        return {j: unit.with_caveat(nameless=guesses[j].bare and not guesses[j].unit) for j, unit in units.items()}
    noticed: dict[int, Noticed] = {}
    for slides in (False, True):
        group = {j: columns[j] for j in guesses if bool(robot.prismatic[j]) == slides}
        base, most = next(iter(OF[kind][slides])), max(map(_most, group.values()), default=0.0)
        smaller = next((unit for unit, limit in UNIT_LIMITS.get(kind.removeprefix("abs_"), ()) if most > limit), "")
        unit = Noticed(smaller, f"reaches {most:.4g}") if smaller else Noticed(base, f"assumed; reaches {most:.4g}")
        if kind in ("dq", "dq_des"):
            pairs = [(positions[j], x) for j, x in group.items() if j in positions and len(seconds)]
            unit = _velocity_unit(pairs, seconds, slides)
        elif kind == "ddq":
            unit = Noticed(base, "assumed")
        elif kind == "pwm":
            values = group.values()
            most = max((_most(signed_register(x)) for x in values), default=0.0)
            if most <= DUTY:
                duty = None
            else:
                scale = next((full for full in REGISTERS if most <= full * (1 + 1e-9)), most)
                how = ", read as unsigned numbers of 16 bits" if any(bool(np.any(x > TURN / 2)) for x in values) else ""
                why = f"reaches {most:.4g}{how}: a full duty of {scale:.4g} is assumed, CHECK"
                duty = Noticed("%" if scale == 100 else Change(1.0 / scale), why)
            unit = duty or unit
        elif "tau" in kind:
            percent, load = any("%" in guesses[j].column for j in group), any(guesses[j].load for j in group)
            unit = Noticed(base, "assumed")
            for j, x in group.items():  # a thousandth where torques are far beyond a limit of the description
                limit, most = float(robot.effort_limit[j]), _most(x)
                if 0 < limit < np.inf and STRONG * limit < most < STRONG * limit * 1e3:
                    why = f"{robot.joints[j]} reaches {most:.4g}, its limit is {limit:.4g} {base}"
                    unit = Noticed(f"m{base}", why)
                    break
            unit = unit.with_caveat(percent=percent, load=load)
        for j in group:
            noticed[j] = Noticed(guesses[j].unit, "named in the column") if guesses[j].unit else unit
    return noticed
