"""Convert logs and tables of any format to the column names and units of recordings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import RecordingError, shorten
from ..types import Array, Frozen, Input, Recording, Robot
from . import read_recording
from .columns import converted, resolve, stated_units, unknown_joints_flag
from .formats.base import About, MemoryTable
from .joining import Files, JoinedFile, open_files
from .mapping import DRIVE, TORQUES, ColumnMap, Heading, ParsedColumns, Signal, read_map, split
from .sampling.clock import read_clock, rivals
from .source import Opened, Source


class Pace(NamedTuple):
    """Timing of a recording."""

    duration: float  # [s]
    rate: float  # [Hz]
    gaps: int
    longest: float  # longest gap [s]


@dataclass(frozen=True, eq=False)
class Conversion(Frozen):
    """Converted columns of N rows and their source."""

    columns: Mapping[str, Array]  # (N,) each, by name [s, rad or m, N.m or N, A; unchanged if the unit is unknown]
    source: Input
    about: About
    units: Mapping[str, str]  # stated units of the source columns
    pace: Pace | None  # None without a usable time column
    flags: tuple[str, ...]
    notes: tuple[str, ...]
    joined: tuple[JoinedFile, ...] = ()  # files besides the source, on its times
    unread: str = ""  # the flag that says why the robot's recording cannot be read from the columns

    @property
    def joints(self) -> dict[str, list[str]]:
        """Kinds of columns by joint."""
        kinds: dict[str, list[str]] = {}
        pairs = [split(name)[0] for name in self.columns if split(name)]
        sure = {joint for kind, joint in pairs if kind not in DRIVE}  # temp_room is no joint
        for kind, joint in pairs:
            if joint in sure:
                kinds.setdefault(joint, []).append(kind)
        return kinds


def convert(
    source: Source | Files,
    *,
    columns: ColumnMap | None = None,
    units: Mapping[str, str] | None = None,
    topics: Sequence[str] = (),
    robot: Robot | None = None,
    drop_missing: bool = False,
    heading: Heading | None = None,
) -> Conversion:
    """Convert all numeric columns to the names and units of recordings; other columns keep their names.

    Reading the converted columns gives the same recording as reading the source. Source, column map and topics are as
    for `read_recording`; `units` are those of the source by kind of column, {"q": "deg", "t": "ns"}. A robot's joint
    names are checked. `heading` states lines before a header and names of columns. `drop_missing` omits rows
    without time, position or torque, which bridges short gaps. `Files` are joined on time first.
    """
    joined = open_files(source, topics, read_map(columns, units, heading))
    opened, mapping = joined.opened, joined.mapping
    signals = _signals(opened, mapping)
    time = next((signal.column for signal in signals if signal.logical == "t" and signal.mapped), "")
    used = {signal.column for signal in signals if split(signal.logical)}
    left = [other for _, other, _ in rivals(opened.table, time, used)] if time else []
    signals = [signal for signal in signals if signal.column not in left]
    about, skipped = About.of(opened.table), []
    kept: dict[str, Array] = {}
    stated: dict[str, str] = {}
    joints = Counter(_joint(signal) for signal in signals)
    for signal in sorted(signals, key=lambda signal: signal.logical != "t"):
        try:
            values, unit = _values(opened, mapping, signal, robot)
        except RecordingError:
            joint = _joint(signal)
            if signal.mapped or signal.logical == "t" or (joint and (joint.isdecimal() or joints[joint] > 1)):
                raise  # of a joint that has other columns; any other one is text
            skipped.append(signal.column)
            continue
        kept[signal.logical] = values
        stated |= {signal.logical: unit} if unit else {}
    notes = list(about.notes)
    if idle := [kind for kind in mapping.units if kind not in map(_kind, kept)]:
        notes.append(f"the unit of {', '.join(idle)} is unused: there is no such column")
    if skipped:
        notes.append(f"omitted, because they hold no numbers: {shorten(skipped)}")
    if left:
        notes.append(f"omitted, because they differ from the stated time: {shorten(left)}")
    strange = []
    if robot and mapping.named:
        unmapped = [signal.logical for signal in signals if not signal.mapped and signal.logical in kept]
        strange = [name for name in unmapped if _kind(name) not in ("", "t", *DRIVE) and resolve(name, robot) is None]
    kept = {name: values for name, values in kept.items() if name not in strange}
    if drop_missing:
        needed = [np.isnan(x) for name, x in kept.items() if _kind(name) in ("t", "q", *TORQUES)]
        lacks = np.any([empty for empty in needed if not empty.all()] or [np.zeros(1, bool)], axis=0)
        if lacks.any():
            kept = {name: values[~lacks] for name, values in kept.items()}
            rows = f"{int(lacks.sum())} of {len(lacks)} rows"
            notes.append(f"{rows} lack a value and are omitted, which bridges short gaps")
    pace, faults = _pace(opened.name, kept)
    flags = [*joined.flags, *faults]
    if robot and strange:
        flags.append(unknown_joints_flag(opened.name, robot, strange, "left out"))
    unread = ""
    if robot:
        try:
            read_recording(kept, robot, columns={})
        except RecordingError as error:
            unread = opened.name + str(error).removeprefix("the recording")
            flags.append(unread)
    file = Input(opened.path or opened.name, opened.sha256, "converted")
    notes += [] if flags else _lacking(kept, about)
    ends = tuple(flags), tuple(dict.fromkeys(notes))
    return Conversion(kept, file, about, stated, pace, *ends, joined.files, unread)


def _kind(name: str) -> str:
    """Kind of a column, "" if it is not a signal."""
    pairs = split(name)
    return pairs[0][0] if pairs else "t" if name == "t" else ""


def _signals(opened: Opened, mapping: ParsedColumns) -> list[Signal]:
    signals = list(mapping.signals(opened.table.columns, opened.name))
    names = [signal.logical for signal in signals]
    if twice := next((name for name, count in Counter(names).items() if count > 1), None):
        both = [signal.column for signal in signals if signal.logical == twice]
        raise RecordingError(f"{opened.name}: {' and '.join(both)} would both be {twice}; correct the column map")
    if not opened.table.rows:
        raise RecordingError(f"{opened.name} has columns but no samples; record the robot in motion")
    return signals


def _joint(signal: Signal) -> str:
    """Joint of a column that identification reads, "" if it is none."""
    pairs = split(signal.logical)
    return pairs[0][1] if pairs and pairs[0][0] not in DRIVE else ""


def _values(opened: Opened, mapping: ParsedColumns, signal: Signal, robot: Robot | None) -> tuple[Array, str]:
    """Column (N,) in the unit of recordings, and its unit in the source.

    Raises:
        RecordingError: the column holds something else than numbers.
    """
    table, kind = opened.table, _kind(signal.logical)
    key = resolve(signal.logical, robot) if robot and kind not in ("", "t") else None
    prismatic = bool(robot.prismatic[key[1]]) if robot and key and key[1] >= 0 else None
    signals = [(kind, signal, prismatic)] if kind else []
    table.read([signal.column], 0, 0)
    stated = stated_units(mapping, [(kind, signal)] if kind else []).get(signal.column)
    values = converted(opened, mapping, signals).read([signal.column], 0, table.rows)[:, 0].copy()
    return values, stated.unit if stated else ""


def _pace(name: str, columns: Mapping[str, Array]) -> tuple[Pace | None, list[str]]:
    """Timing of the rows, and its faults."""
    if "t" not in columns:
        return None, []
    stamps = columns["t"]
    alone = Recording((), MemoryTable({"t": stamps}, {}, name), {"t": ("t",)}, np.ones(0), np.ones(0, bool))
    try:
        clock = read_clock(alone, name)
    except RecordingError as error:
        return None, [str(error)]
    steps = np.diff(stamps[~np.isnan(stamps)])
    long = steps[steps > clock.gap]
    pace = Pace(float(steps.sum()), 1 / clock.period, len(long), float(long.max(initial=0.0)))
    back = int(np.sum(steps < 0))
    return pace, [f"{name}: time goes back after {back} of its rows; sort the rows by time"] if back else []


def _lacking(columns: Mapping[str, Array], about: About) -> Iterator[str]:
    """Notes on missing columns that identification needs."""
    kinds = {*map(_kind, columns)}
    driven = kinds & {*TORQUES} or "q_des" in kinds
    for has, signal in (("t" in kinds, "time t"), ("q" in kinds, "position q_J"), (driven, "torque tau_J")):
        if not has and not any("no torque" in note for note in about.notes if signal.startswith("torque")):
            yield f"there is no column of {signal}, which identification needs"
