"""Draft a complete column map from the names and numbers of the columns of a log; the user checks it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import RecordingError, one_line, shorten
from ..types import Array, Robot, ServoSamples
from .columns import TORQUES, Noticed, current_unit, drive_unit, position_units, time_unit, torque_unit, velocity_unit
from .formats.base import About
from .joining import Files, open_files
from .names.mapping import DRIVE, Heading, MotorRange, calibrated, entry, heading_lines, key_of, quoted, read_map, split
from .names.match import Guess, guess_columns, match_signals, pair_in_order
from .names.vocabulary import Change, change_of, without_unit
from .sampling.clock import rivals
from .source import Opened, Source

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
    values = dict(_numbers(opened))
    guesses = guess_columns(list(values), robot)
    matched = list(match_signals(guesses, robot))
    signals = {key: one for key, one in matched if not one.desired}
    spare = [one.column for _, one in matched if one.desired]
    signals, time = _unsigned(signals, values), _time(guesses, values)
    unstated = About.of(opened.table).unstated
    lines = tuple(
        line._replace(noticed=line.noticed.with_caveat(unstated=True))
        if line.kind in ("q", "q_des") and line.guess.column in unstated
        else line
        for line in _lines(signals, time, values, robot)
    )
    lines = _calibrated(lines, values, ranges or {})
    offered = tuple((key, one.column) for key, one in pair_in_order(guesses, signals, robot))
    used = {line.guess.column for line in lines} | {column for _, column in offered}
    unused = tuple(name for name in opened.table.columns if name not in used)
    lacking = tuple(_lacking(lines, opened, used))
    text = _text(opened.name, robot, lines, offered, spare=spare, unused=unused, lacking=lacking)
    text += _missing([values[line.guess.column] for line in lines]) + SECTIONS
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
        joint: np.concatenate([values[column] for column, own in positions.items() if own == joint])
        for joint in dict.fromkeys(positions.values())
    }
    found = calibrated(pooled, ranges)
    return tuple(
        line._replace(noticed=Noticed(found[line.guess.joint].change or "deg", found[line.guess.joint].why))
        if line.guess.column in positions and line.guess.joint in found
        else line
        for line in lines
    )


def _numbers(opened: Opened) -> Iterator[tuple[str, Array]]:
    """Columns of numbers, (rows,) each."""
    for name in opened.table.columns:
        try:
            yield name, opened.table.read([name], 0, min(opened.table.rows, ROWS))[:, 0]
        except RecordingError:  # a column of texts
            continue


def _unsigned(signals: Mapping[str, Guess], values: Mapping[str, Array]) -> dict[str, Guess]:
    """Signals, where torques of which none is ever negative become absolute values."""
    found = dict(signals)
    for kind in ("tau", "current"):
        mine = [key for key, one in signals.items() if one.kind == kind]
        if len(mine) > 1 and all(np.nanmin(values[signals[key].column], initial=np.inf) >= 0 for key in mine):
            for key in mine:
                one = found.pop(key)
                found.setdefault(f"abs_{key}", one._replace(kind=f"abs_{kind}"))
    return found


def _time(guesses: Sequence[Guess], values: Mapping[str, Array]) -> Guess | None:
    """Column of time that increases most steadily; the one named t first."""
    best: tuple[float, Guess] | None = None
    for one in sorted((one for one in guesses if one.kind == "t"), key=lambda one: not one.plain):
        steps = np.diff(values[one.column])
        share = float(np.mean(steps > 0)) if len(steps) else 0.0
        if best is None or share > best[0] + 0.05:
            best = share, one
    return best[1] if best else None


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
        mine = {place[key[len(kind) + 1 :]]: (key, one) for key, one in signals.items() if one.kind == kind}
        columns = {j: values[one.column] for j, (_, one) in mine.items()}
        noticed_units = _units(kind, {j: one for j, (_, one) in mine.items()}, columns, positions, seconds, robot)
        for j in sorted(mine):
            key, one = mine[j]
            yield MappedColumn(key, kind, j, one, noticed_units[j])
        if kind == "q":
            for j in mine:
                unit = noticed_units[j].unit
                change = unit if isinstance(unit, Change) else change_of(unit, "q", None, "q")
                positions[j] = change.apply(columns[j])


def _units(
    kind: str,
    guesses: Mapping[int, Guess],
    columns: Mapping[int, Array],
    positions: Mapping[int, Array],
    seconds: Array,
    robot: Robot,
) -> dict[int, Noticed]:
    """Unit of each column of a kind, by index of the joint; positions are in rad or m."""
    if kind in ("q", "q_des"):
        counts = any(one.counts for one in guesses.values())
        units = position_units(columns, {j: one.unit for j, one in guesses.items()}, counts, robot)
        return {j: unit.with_caveat(nameless=guesses[j].bare and not guesses[j].unit) for j, unit in units.items()}
    found: dict[int, Noticed] = {}
    for slides in (False, True):
        mine = [j for j in guesses if bool(robot.prismatic[j]) == slides]
        if not mine:
            continue
        if kind in DRIVE:
            unit = drive_unit(kind, {j: columns[j] for j in mine})
        elif kind in ("dq", "dq_des"):
            pairs = [(positions[j], columns[j]) for j in mine if j in positions and len(seconds)]
            unit = velocity_unit(pairs, seconds, slides)
        elif kind == "ddq":
            unit = Noticed("m/s2" if slides else "rad/s2", "assumed")
        elif kind.endswith("current"):
            unit = current_unit({j: columns[j] for j in mine})
        else:
            unit = torque_unit({j: columns[j] for j in mine}, robot, slides)
            percent, load = any("%" in guesses[j].column for j in mine), any(guesses[j].load for j in mine)
            unit = unit.with_caveat(percent=percent, load=load)
        for j in mine:
            named = guesses[j].unit
            found[j] = Noticed(named, "named in the column") if named else unit
    return found


def _lacking(lines: Sequence[MappedColumn], opened: Opened, used: Collection[str]) -> Iterator[str]:
    """Kinds of columns that are lacking, and columns of time that differ from the one of the map."""
    kinds = {line.kind for line in lines}
    for has, what in (
        ("t" in kinds, "time"),
        ("q" in kinds, "positions"),
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
    shared = {kind: _shared([line for line in lines if line.kind == kind]) for kind in ("t", *ORDER)}
    out = [
        f"# Reading of {quoted(source)} for the robot {quoted(robot.name)}, drafted by signid",
        "# from the names of the columns and from their numbers. Read it, correct lines with which? or CHECK, and run",
        "# the command again. Units: deg, rad, mm, m, ms, us, ns, s, mN.m, N.m, mA, A, ...; or scale and offset:",
        "# value * scale + offset.",
        "",
        "[columns]",
    ]
    for kind, unit in shared.items():
        mine = [line for line in lines if line.kind == kind]
        keys = [(key, column) for key, column in offered if split(key)[0][0] == kind]
        if kind != "t" and (mine or keys):
            out += ["", *_section(kind, mine, unit)]
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


def _missing(columns: Sequence[Array]) -> str:
    """Section on missing values of columns (rows,), with the number of rows that lack one."""
    lost = np.asarray(np.isnan(columns).any(axis=0)) if columns else np.zeros(0, bool)
    said = f"# {int(lost.sum())} of {len(lost)} rows lack a value: short holes are bridged\n" if lost.any() else ""
    return f"\n[missing]\n{said}# values = [-999]  # numbers that stand for a missing value\n"


def _shared(lines: Sequence[MappedColumn]) -> Noticed | None:
    """The unit that all lines of a kind have, with the reason of the clearest; None if they differ."""
    units = {line.noticed.unit for line in lines}
    if len(units) != 1 or isinstance(next(iter(units)), Change):
        return None
    return max((line.noticed for line in lines), key=lambda one: "assumed" not in one.why)


def _section(kind: str, lines: Sequence[MappedColumn], shared: Noticed | None) -> Iterator[str]:
    """Title and lines of a kind; a unit that is not shared stands in each line, and its reason where reasons differ."""
    reasons = {line.noticed.why for line in lines}
    alike = len(reasons) == 1
    yield f"# {TITLES.get(kind, 'time')}" + (f": {one_line(min(reasons))}" if alike and not shared else "")
    for line in lines:
        key, column, unit = key_of(line.signal), quoted(line.guess.column), line.noticed.unit
        if shared:
            yield f"{key} = {column}"
            continue
        if isinstance(unit, Change):
            fields = f"scale = {unit.scale!r}, offset = {unit.offset!r}"
        else:
            fields = f"unit = {quoted(unit)}"
        yield f"{key} = {{ column = {column}, {fields} }}" + ("" if alike else f"  # {one_line(line.noticed.why)}")
