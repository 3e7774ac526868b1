"""Recordings of robots that are not described: columns by the names that they have."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path

import numpy as np

from ..errors import RecordingError, shorten
from ..types import Array, Recording, ServoSamples
from .columns import TORQUES, UNSTATED, conversion, function, stated_units, unit_caveats
from .formats import FORMATS
from .formats.base import About
from .formats.json_ import holds_samples
from .names.mapping import ColumnMap, DerivedTable, ParsedColumns, Signal, read_map, split
from .names.match import guess
from .read import drop_implausible
from .sampling.clock import ask_for_time
from .source import Opened, Source, open_source

DESCRIPTIONS = (".urdf", ".xacro", ".xml", ".mjcf", ".toml")  # suffixes that are of no recording
KINDS = ("q", "dq", "q_des", *ServoSamples._fields)


def is_recording(name: str) -> bool:
    """Whether a file or folder of that name exists and has the format of a recording."""
    path = Path(name)
    if not path.exists() or path.name.lower().endswith(DESCRIPTIONS):
        return False
    if path.suffix.lower() == ".json" and not holds_samples(path):
        return False
    return any(FORMATS[each].recognises(path) for each in FORMATS.names)


def read_bare(
    source: Source, *, columns: ColumnMap | None = None, topics: Sequence[str] = ()
) -> tuple[Recording, dict[str, str]]:
    """Read positions, commands and what drives record of every joint with `q_J` and `q_des_J`, without a description.

    Torques are not read. Without such names and without a column map, the words in the names of columns assign them,
    and a note says how. Also returned is the unit of the positions of each joint: "" where the source states none, as
    LeRobot datasets and columns that are assigned by words; all others are rad, or m at prismatic joints, which look
    the same.

    Raises:
        OptionError: topics of a source without topics.
        RecordingError: invalid file, columns or column map, or no joint has both columns.
    """
    mapping = read_map(columns)
    opened = open_source(source, topics, mapping.heading)
    signals = _signals(opened, mapping)
    guessed = {} if columns is not None or _commanded(signals) else _guessed_columns(opened.table.columns)
    if guessed:
        mapping = read_map(guessed, mapping.units, mapping.heading)
        signals = _signals(opened, mapping)
    joints = _joints(opened, signals)
    if not signals["t"].mapped:
        ask_for_time(opened.table, "t", {each.column for name, each in signals.items() if split(name)}, opened.name)
    chosen = {kind: tuple(_column(signals, kind, joint) for joint in joints) for kind in KINDS}
    functions: dict[str, Callable[[Array, int], Array]] = {}
    unknown: set[tuple[str, str]] = set()
    for kind, joint in product(KINDS, joints):
        if signal := signals.get(f"{kind}_{joint}"):
            unstated = _unstated(opened, mapping, signal, kind)
            nameless = guessed and not mapping.own.get(signal.logical) and kind not in mapping.units
            unknown |= {(kind, joint)} if unstated or nameless else set()
            change = function(kind, None if unstated else conversion(opened, mapping, signal, kind, None))
            functions |= {signal.column: change} if change else {}
    time = conversion(opened, mapping, signals["t"], "t", None)
    functions |= {signals["t"].column: time.apply} if time else {}
    table = DerivedTable(opened.table, functions) if functions else opened.table
    used = [signals["t"].column, *(name for names in chosen.values() for name in names if name)]
    table.read(used, 0, 0)  # raises if a column is not numeric
    plain, implausible = drop_implausible(table, chosen)
    units = stated_units(mapping, ((split(name)[0][0] if split(name) else "t", each) for name, each in signals.items()))
    units = {name: unit._replace(by="its name") if guessed else unit for name, unit in units.items() if name in used}
    caveats = unit_caveats(opened, units)
    if unknown and About.of(opened.table).unstated:
        caveats += (f"positions are left in the unit of the source: {UNSTATED}",)
    notes: tuple[str, ...] = (*(note for note in About.of(opened.table).notes if "no torque" not in note), *caveats)
    if guessed:
        names = [f"{key} is {name}" for key, name in mapping.named.items() if key == "t" or key.startswith("q_")]
        notes += (f"columns are assigned by the words in their names: {shorten(names, 4)}",)
    recording = Recording(
        joints,
        table,
        {"t": (signals["t"].column,), "tau": ("",) * len(joints), **plain},
        np.ones(len(joints)),
        np.ones(len(joints), bool),
        opened.path,
        opened.sha256,
        notes,
        flags=tuple(implausible),
        units=units,
    )
    return recording, {joint: "" if ("q", joint) in unknown else "rad" for joint in joints}


def _column(signals: dict[str, Signal], kind: str, joint: str) -> str:
    signal = signals.get(f"{kind}_{joint}")
    return signal.column if signal else ""


def _unstated(opened: Opened, mapping: ParsedColumns, signal: Signal, kind: str) -> bool:
    """Whether neither the source nor the map states the unit of a column."""
    stated = mapping.units.get(kind) or signal.unit or (signal.mapped and mapping.own.get(signal.logical))
    return not stated and signal.column in About.of(opened.table).unstated


def _signals(opened: Opened, mapping: ParsedColumns) -> dict[str, Signal]:
    return {signal.logical: signal for signal in mapping.signals(opened.table.columns, opened.name)}


def _commanded(signals: Mapping[str, Signal]) -> tuple[str, ...]:
    """Joints with a position and a command, in the order of the columns."""
    joints = [token for name in signals for kind, token in split(name)[:1] if kind == "q"]
    return tuple(joint for joint in joints if f"q_des_{joint}" in signals)


def _guessed_columns(columns: Sequence[str]) -> dict[str, str | dict[str, str]]:
    """Entries of a column map of commanded and measured positions by the words of their names; {} without both."""
    found = [one for column in columns if (one := guess(column)) and not one.desired]
    entries: dict[str, str | dict[str, str]] = {}
    for one in found:
        key = "t" if one.kind == "t" else f"{one.kind}_{one.joint or 'joint'}"
        entries.setdefault(key, {"column": one.column, "unit": one.unit} if one.unit else one.column)
    both = any(key.startswith("q_des_") and f"q_{key[6:]}" in entries for key in entries)
    return entries if both and "t" in entries else {}


def _joints(opened: Opened, signals: Mapping[str, Signal]) -> tuple[str, ...]:
    """Joints with a position and a command.

    Raises:
        RecordingError: there is none, or no time.
    """
    found = _commanded(signals)
    have = f"it has {shorten(opened.table.columns, 12)}"
    advice = "name them in a column map (--columns), or give the description of the robot before the recording"
    if "t" not in signals:
        raise RecordingError(f"{opened.name} has no column 't' of time in seconds; {have}; {advice}")
    if not found:
        torque = any(name.startswith(tuple(f"{kind}_" for kind in TORQUES)) for name in signals)
        also = "; a recording of torque needs a description: signid check ROBOT RECORDING" if torque else ""
        raise RecordingError(f"{opened.name} has no joint J with both columns q_J and q_des_J; {have}; {advice}{also}")
    return found
