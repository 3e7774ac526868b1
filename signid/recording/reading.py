"""The reading of a log, which turns it into rows: found beside it, or drafted from names and numbers of its columns."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import RecordingError, UndecidedReading, one_line, readable, shorten
from ..types import Array, Reading, Recording, Robot, ServoSamples, Table
from .columns import UNSTATED, Noticed, noticed_units, time_unit
from .formats.base import About
from .joining import Files, open_files
from .mapping import DRIVE, TORQUES, Heading, MotorRange, calibrated, entry, heading_lines, quoted, read_map, split
from .match import Guess, by_place_in_arm, guess, guess_columns, match_signals, pair_in_order
from .sampling.clock import increasing, numbers_of, rivals
from .source import Opened, Source
from .vocabulary import Change, change_of, without_unit

CHECK = "CHECK"  # in the reason of a unit that the user is to check
COMMAND = 0.999  # correlation of a torque with kp (q_des - q) - kd dq above which it is a command
MAX_COMMAND_ROWS, MIN_COMMAND_ROWS = 20_000, 100  # [rows] that decide it, at most and at least
LISTED_KINDS = ("t", "q", "q_des", "dq", *TORQUES)  # kinds of columns that a reading lists
ROWS = 200_000  # rows whose numbers are examined
ORDER = ("q", "dq", "ddq", "tau", "abs_tau", "current", "abs_current", "q_des", *ServoSamples._fields)
TITLES = {
    "q": "positions",
    "dq": "velocities",
    "ddq": "accelerations",
    "tau": "torques",
    "abs_tau": "torques without their signs",
    "current": "motor currents (torque_constant of the actuators file makes torques of them)",
    "abs_current": "motor currents without their signs",
    "q_des": "desired positions",
    "dq_des": "desired velocities",
    "tau_ff": "torques fed forward",
    "on": "whether the drives hold, 1 or 0",
    "pwm": "duties, -1 to 1",
    "volt": "supply voltages",
    "temp": "temperatures",
}
SECTIONS = """
[torque_constant]  # at the joint [N.m/A, or N/A]; without a line that of the actuators file, or an estimate

[gravity]
# vector = [0, 0, -9.81]  # [m/s2] in the frame of the root link
"""  # of a reading, to fill in


def draft_reading(
    source: Source | Files,
    robot: Robot,
    topics: Sequence[str],
    error: RecordingError,
    heading: Heading | None = None,
    ranges: Mapping[str, MotorRange] | None = None,
) -> Reading:
    """Draft the reading of a log whose columns are none of a recording; `heading` and `ranges` as of `draft_map`.

    Raises:
        RecordingError: `error`, which its own names led to, if others mean no positions and torques, or are its own
            and no `ranges` are given.
        UndecidedReading: lines are to be chosen.
    """
    try:
        drafted = draft_map(source, robot, topics, heading, ranges)
    except ValueError:
        raise error from None
    kinds = {line.kind for line in drafted.lines} | {key.partition("_")[0] for key, _ in drafted.offered}
    driven = kinds & {*TORQUES, "q_des"}
    arm = by_place_in_arm({line.guess.joint for line in drafted.lines if line.kind == "q"}, robot)
    uncertain = arm or ranges is not None or any(UNSTATED in line.noticed.why for line in drafted.lines)
    named = all(line.guess.plain for line in drafted.lines) and not uncertain
    if not kinds & {"q", "dq"} or not (driven or "volt" in kinds) or named:
        known = [entry(line.signal, line.guess.column, "") for line in drafted.lines]
        raise error if named or not known else RecordingError(f"{error}; recognised are {shorten(known)}")
    if driven and (choices := [*_choices(drafted, bool(driven & {*TORQUES}))]):
        if not isinstance(source, str | Path | Files):
            raise error  # which says what to write; there is no file to lie beside
        name = readable(" + ".join(map(str, source.paths)) if isinstance(source, Files) else str(source))
        raise UndecidedReading(f"{name}: lines of its reading are to be chosen: {', '.join(choices)}", drafted.text)
    rows: list[tuple[str, str, str, str]] = []
    for joint, name in enumerate(("time", *robot.joints), -1):
        lines = [line for line in drafted.lines if line.joint == joint and line.kind in LISTED_KINDS]
        units, reasons = [str(line.noticed.unit) for line in lines], dict.fromkeys(line.noticed.why for line in lines)
        if name in arm.values():
            reasons["joint by its place in the arm"] = None
        if any(line.kind.endswith("current") for line in lines):
            constant = float(robot.actuators.torque_constant[joint])
            fact = f"{constant:.4g}, stated" if constant == constant else "to be estimated"
            reasons[f"torque constant {fact}"] = None
        if lines:
            rows.append((name, ", ".join(line.guess.column for line in lines), ", ".join(units), "; ".join(reasons)))
    return Reading(drafted.text, tuple(rows))


def _choices(drafted: DraftedMap, torque: bool) -> Iterator[str]:
    """Clauses on what is to be chosen."""
    if drafted.offered:
        pairs = [f"{column} for {signal}" for signal, column in drafted.offered]
        yield f"choose the joints of columns (which?: {shorten(pairs, 3)})"
    guessed = {line.kind: line for line in drafted.lines if CHECK in line.noticed.why}
    for kind, line in guessed.items():
        if not (torque and kind in DRIVE):
            yield f"check the unit of {kind} ({line.noticed.why.removesuffix(f': {CHECK}').removesuffix(f', {CHECK}')})"
    yield from ((sentence.partition(": ")[2] or sentence).partition("; ")[0] for sentence in drafted.lacking)


def commanded_torques(recording: Recording) -> Iterator[str]:
    """A note on each torque that is no measurement: kp (q_des - q) - kd dq of the same rows explains it."""
    if not any(recording.columns["q_des"]) or not any(recording.columns["tau"]):
        return
    rows = recording.read(0, MAX_COMMAND_ROWS, servo=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        v = np.gradient(rows.q, rows.t, axis=0) if rows.dq is None and len(rows.t) > 1 else rows.dq
    if v is None or rows.q_des is None:
        return
    for j, name in enumerate(recording.joints):
        columns = np.column_stack([rows.q_des[:, j] - rows.q[:, j], -v[:, j], rows.tau[:, j]])
        columns = columns[np.isfinite(columns).all(axis=1)]
        errors, tau = columns[:, :2], columns[:, 2]
        if len(tau) < MIN_COMMAND_ROWS or not recording.signed[j] or not tau.std():
            continue
        kp, kd = np.linalg.lstsq(errors, tau, rcond=None)[0].tolist()
        alike = float(np.corrcoef(errors @ [kp, kd], tau)[0, 1]) if (errors @ [kp, kd]).std() else 0.0
        if alike > COMMAND and kp > 0:
            fact = f"the torque of {name} is a command, not a measurement: {kp:.4g} (q_des - q) - {kd:.4g} dq"
            yield f"{fact} explains it (correlation {alike:.5f})"


class MappedColumn(NamedTuple):
    """A signal, its column and its unit."""

    signal: str  # "q_elbow"
    kind: str
    joint: int  # -1 for t
    guess: Guess
    noticed: Noticed


class DraftedMap(NamedTuple):
    """A drafted column map."""

    text: str  # TOML
    lines: tuple[MappedColumn, ...]
    unused: tuple[str, ...]  # columns without a meaning
    lacking: tuple[str, ...]  # what identification needs and no column seems to have, one sentence each
    offered: tuple[tuple[str, str], ...] = ()  # signals of joints that no column fits, and columns that may be theirs


def draft_map(
    source: Source | Files,
    robot: Robot,
    topics: Sequence[str] = (),
    heading: Heading | None = None,
    ranges: Mapping[str, MotorRange] | None = None,
) -> DraftedMap:
    """Draft a column map of a log for a robot; names of columns and their first 200,000 rows give joints and units.

    `heading` states lines before a header, and names of columns; the map then holds them as well. `ranges` are those of
    a calibration file, by which positions in per cent become angles. Joints that no column fits are offered the columns
    that are left, in their order, as comments.

    Raises:
        OptionError: topics of a source without topics.
        RecordingError: the source cannot be read.
    """
    opened = open_files(source, topics, read_map(None, None, heading)).opened
    values = dict(numbers_of(opened.table, opened.table.columns, ROWS))
    guesses = guess_columns(list(values), robot)
    matched = list(match_signals(guesses, robot))
    signals = {key: meant for key, meant in matched if not meant.desired}
    spare = [meant.column for _, meant in matched if meant.desired]
    best: tuple[float, Guess] | None = None
    for column in sorted((column for column in guesses if column.kind == "t"), key=lambda column: not column.plain):
        steps = np.diff(values[column.column])
        share = float(np.mean(steps > 0)) if len(steps) else 0.0
        if best is None or share > best[0] + 0.05:
            best = share, column
    signals, time = _unsigned(signals, values), (best[1] if best else None)
    unstated = About.of(opened.table).unstated
    lines = tuple(
        line._replace(noticed=line.noticed.with_caveat(unstated=True))
        if line.kind in ("q", "q_des") and line.guess.column in unstated
        else line
        for line in _lines(signals, time, values, robot)
    )
    lines = _calibrated(lines, values, ranges or {})
    offered = tuple((key, meant.column) for key, meant in pair_in_order(guesses, signals, robot))
    used = {line.guess.column for line in lines} | {column for _, column in offered}
    unused = tuple(name for name in opened.table.columns if name not in used)
    lacking = tuple(_lacking(lines, opened, used))
    text = _text(opened.name, robot, lines, offered, spare=spare, unused=unused, lacking=lacking)
    gaps = [np.isnan(values[line.guess.column]) for line in lines]
    lost = np.asarray(np.any(gaps, axis=0)) if gaps else np.zeros(0, bool)
    said = f"# {int(lost.sum())} of {len(lost)} rows lack a value: short holes are bridged\n" if lost.any() else ""
    text += f"\n[missing]\n{said}# values = [-999]  # numbers that stand for a missing value\n{SECTIONS}"
    if stated := heading_lines(heading or Heading()):
        top, first, rest = text.partition("\n\n")
        text = "".join((top, "\n\n", "\n".join(stated), first, rest))
    return DraftedMap(text, lines, unused, lacking, offered)


def _calibrated(
    lines: Sequence[MappedColumn], values: Mapping[str, Array], ranges: Mapping[str, MotorRange]
) -> tuple[MappedColumn, ...]:
    """Lines in which the calibrated ranges state the unit of positions; both kinds of position share it."""
    positions = {line.guess.column: line.guess.joint for line in lines if line.kind in ("q", "q_des")}
    pooled = {
        joint: np.concatenate([values[column] for column, motor in positions.items() if motor == joint])
        for joint in dict.fromkeys(positions.values())
    }
    ranged = calibrated(pooled, ranges)
    return tuple(
        line._replace(noticed=Noticed(ranged[line.guess.joint].change or "deg", ranged[line.guess.joint].why))
        if line.guess.column in positions and line.guess.joint in ranged
        else line
        for line in lines
    )


def _unsigned(signals: Mapping[str, Guess], values: Mapping[str, Array]) -> dict[str, Guess]:
    """Signals, where torques of which none is ever negative become absolute values."""
    unsigned = dict(signals)
    for kind in ("tau", "current"):
        keys = [key for key, column in signals.items() if column.kind == kind]
        if len(keys) > 1 and all(np.nanmin(values[signals[key].column], initial=np.inf) >= 0 for key in keys):
            for key in keys:
                column = unsigned.pop(key)
                unsigned.setdefault(f"abs_{key}", column._replace(kind=f"abs_{kind}"))
    return unsigned


def _lines(
    signals: Mapping[str, Guess], time: Guess | None, values: Mapping[str, Array], robot: Robot
) -> Iterator[MappedColumn]:
    t, seconds = np.zeros(0), np.zeros(0)
    if time is not None:
        t = values[time.column]
        noticed = time_unit(t, time.unit)
        seconds = change_of(str(noticed.unit), "t", None, "t").apply(t - t[0] if len(t) else t)
        yield MappedColumn("t", "t", -1, time, noticed)
    place = {name: j for j, name in enumerate(robot.joints)}
    positions: dict[int, Array] = {}
    for kind in ORDER:
        of_kind = {place[key[len(kind) + 1 :]]: (key, meant) for key, meant in signals.items() if meant.kind == kind}
        columns = {j: values[meant.column] for j, (_, meant) in of_kind.items()}
        units = noticed_units(kind, {j: meant for j, (_, meant) in of_kind.items()}, columns, positions, seconds, robot)
        for j in sorted(of_kind):
            key, meant = of_kind[j]
            yield MappedColumn(key, kind, j, meant, units[j])
        if kind == "q":
            for j in of_kind:
                unit = units[j].unit
                change = unit if isinstance(unit, Change) else change_of(unit, "q", None, "q")
                positions[j] = change.apply(columns[j])


def _lacking(lines: Sequence[MappedColumn], opened: Opened, used: Collection[str]) -> Iterator[str]:
    """Kinds of columns that are lacking, and columns of time that differ from the one of the map."""
    kinds = {line.kind for line in lines}
    for has, what in (
        ("t" in kinds, "time"),
        (bool(kinds & {"q", "dq"}), "positions or speeds"),
        (bool(kinds & {*TORQUES, "q_des"}), "torques, currents or desired positions"),
    ):
        if not has:
            yield f"{opened.name}: no column of {what} was recognised; add lines for them to the map"

    for time in (line.guess.column for line in lines if line.kind == "t"):
        for first, other, apart in rivals(opened.table, time, {*used} - {time}):
            yield f"{first} and {other} differ by up to {apart * 1e3:.3g} ms; choose the time of the samples for t"


def _text(
    source: str,
    robot: Robot,
    lines: Sequence[MappedColumn],
    offered: Sequence[tuple[str, str]],
    *,
    spare: Sequence[str],
    unused: Sequence[str],
    lacking: Sequence[str],
) -> str:
    """The map as TOML, one line per signal with its reason."""
    shared: dict[str, Noticed | None] = {}  # the unit that all lines of a kind have, with the reason of the clearest
    for kind in ("t", *ORDER):
        noticed = [line.noticed for line in lines if line.kind == kind]
        alike = len({unit.unit for unit in noticed}) == 1 and not isinstance(noticed[0].unit, Change)
        shared[kind] = max(noticed, key=lambda unit: "assumed" not in unit.why) if alike else None
    out = [
        f"# Reading of {quoted(source)} for the robot {quoted(robot.name)}, drafted by signid",
        "# from the names of the columns and from their numbers. Read it, correct lines with which? or CHECK, and run",
        "# the command again. Units: deg, rad, mm, m, ms, us, ns, s, mN.m, N.m, mA, A, ...; or scale and offset:",
        "# value * scale + offset.",
        "",
        "[columns]",
    ]
    for kind, unit in shared.items():
        of_kind = [line for line in lines if line.kind == kind]
        keys = [(key, column) for key, column in offered if split(key)[0][0] == kind]
        if kind != "t" and (of_kind or keys):
            out += ["", *_section(kind, of_kind, unit)]
            units = {column: "" if unit else without_unit(column)[1] for _, column in keys}
            out += [f"# {entry(key, column, units[column])}  # which?" for key, column in keys]
    if lacking:
        out += ["", *(f"# {one_line(sentence)}" for sentence in lacking)]
    measured = {line.joint for line in lines if line.kind == "q"}
    how = ", unless a line with 'which?' is right: remove its first #" if offered else ""
    for fact, names in (
        (f"without a position, and held fixed{how}", [x for j, x in enumerate(robot.joints) if j not in measured]),
        ("commanded, not measured, and not used", [name for name in unused if name in spare]),
        ("not used", [name for name in unused if name not in spare]),
    ):
        if names:
            out += ["", f"# {fact}: {shorten([quoted(name) for name in names], 12)}"]
    if any(shared.values()):
        out += ["", "[units]  # of all columns of a kind"]
        out += [f"{kind} = {quoted(str(unit.unit))}  # {one_line(unit.why)}" for kind, unit in shared.items() if unit]
    time = next((line for line in lines if line.kind == "t"), None)
    clock = f"time = {quoted(time.guess.column)}" if time else "# rate = 100  # [Hz] of rows without a column of time"
    return "\n".join([*out, "", "[clock]", clock, ""])


def _section(kind: str, lines: Sequence[MappedColumn], shared: Noticed | None) -> Iterator[str]:
    """Title and lines of a kind; a unit that is not shared stands in each line, and its reason where reasons differ."""
    reasons = {line.noticed.why for line in lines}
    same_reason = len(reasons) == 1
    yield f"# {TITLES.get(kind, 'time')}" + (f": {one_line(min(reasons))}" if same_reason and not shared else "")
    for line in lines:
        text = entry(line.signal, line.guess.column, "" if shared else line.noticed.unit)
        yield text if shared or same_reason else f"{text}  # {one_line(line.noticed.why)}"


def lacking_time(table: Table, used: Collection[str]) -> str:
    """Advice on a table without a column of time; `used`: columns of signals.

    The only other column that increases from row to row is offered, unless it counts the rows.
    """
    if any((guessed := guess(name)) and guessed.kind == "t" for name in table.columns):
        return "add it, or name it in a column map (--columns)"
    state = "state the rate of its rows [Hz], --rate 100 (0: each row is a posture at rest)"
    rising = [(name, t) for name, t in increasing(table, [x for x in table.columns if x not in used]) if t[0] < t[-1]]
    steps = {name: np.diff(t) for name, t in rising}
    times = {name: t for name, t in rising if np.all(steps[name] > 0) and not np.all(steps[name] == 1)}
    if len(times) == 1:
        [(name, t)] = times.items()
        line = f"t = {{ column = {quoted(name)}, unit = {quoted(str(time_unit(t, without_unit(name)[1]).unit))} }}"
        return f"{name} is the only column that increases: if it is time, write {line} into a column map (--columns)"
    counts = [name for name in steps if name not in times and np.all(steps[name] == 1)]
    return (
        f"{shorten(counts)} counts the rows; {state}"
        if counts
        else f"add it, or {state}, or name it in a column map (--columns)"
    )
