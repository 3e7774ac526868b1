"""Read recordings of a robot, as paths, arrays or frames, and apply recovered signs."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from ..errors import OptionError, RecordingError, shorten, unexpected
from ..robot import as_robot, resting
from ..typed import typed
from ..types import Array, Recording, Robot, ServoSamples, Table
from .columns import UNSTATED, Assignment, assign_columns, converted, stated_units, unit_caveats
from .formats import FORMATS, PICKLED
from .formats.base import About
from .formats.json_ import holds_samples
from .mapping import TORQUES, ColumnMap, DerivedTable, ParsedColumns, Signal, read_heading, read_map, split
from .match import guess
from .missing import are_postures, at_rest, bridge, with_positions, with_repaired_stamps, without_dead_torques
from .reading import commanded_torques, draft_reading, lacking_time
from .sampling.clock import CHUNK, ask_for_time
from .source import Opened, Source, columns_of, found_reading, open_source, reading_beside

POSITIONS = ("q", "dq", "ddq", "q_des")
PLAUSIBLE = {  # smallest and largest accepted value of columns of drives
    "pwm": (-1.01, 1.01, 'duties from -1 to 1: state [units] pwm = "%" or a scale in a column map (--columns)'),
    "on": (0.0, 1.0, "1 while the drive holds and 0 while it does not"),
    "volt": (0.0, 1e3, 'volts: state [units] volt = "mV" or "dV" in a column map (--columns)'),
}
MIDDLE = 0.1  # share of the largest value below, or beside, which duties lie that were read as unsigned numbers
UNWRAP = (
    "it holds signed numbers of 16 bits that were read as unsigned and then scaled: give the register itself and its "
    "scale in a column map (--columns)"
)
Recordings = Recording | Source | Sequence[Recording | Source]
DESCRIPTIONS = (".urdf", ".xacro", ".xml", ".mjcf", ".toml")  # suffixes that are of no recording
KINDS = ("q", "dq", "q_des", *ServoSamples._fields)


@typed
def read_recording(
    source: Source,
    robot: Robot | str | Path,
    *,
    columns: ColumnMap | None = None,
    unsigned: bool = False,
    topics: Sequence[str] = (),
    rate: float | None = None,
) -> Recording:
    """Read a recording of a robot.

    >>> len(signid.read_recording("robots/3r/recording.parquet", "3r"))
    6000

    Required columns are `t` and, for each joint J by name or number, `q_J` and one of `tau_J`, `current_J`,
    `abs_tau_J` and `abs_current_J` (absolute values), or the commanded position `q_des_J` of a servo; `dq_J`, `ddq_J`,
    `q_des_J` and the columns of `ServoSamples` (`on_J`, `pwm_J`, ...) are optional. A signed current requires the
    torque constant of the joint; for an absolute current, sign recovery can estimate it. Samples of a Parquet file are
    read on demand.

    A file with other names is read by LOG.reading.toml beside it, else by a reading that is drafted from names and
    numbers of its columns, if nothing in it is to be chosen.

    Args:
        source: a file, a ROS bag, a LeRobot dataset, a frame of pandas or polars, or arrays by column name: (N,), or
            (N, n) for all joints [s, rad or m, N.m or N, A].
        robot: the recorded robot, or what `load_robot` reads.
        columns: column map, or a TOML file of it: {"q_elbow": "elbow_pos"}, with units
            {"q_elbow": {"column": "elbow_pos", "unit": "deg"}} or {"units": {"q": "deg"}}.
        unsigned: whether to discard the sign of every torque.
        topics: topics of a ROS bag, joined in time; by default the only suitable one.
        rate: [Hz] of the rows of a source without times; 0: each row is a posture at rest.

    Raises:
        OptionError: topics of a source without topics.
        RecordingError: invalid file, columns or column map.
        UndecidedReading: lines of the drafted reading are to be chosen.
    """
    robot, column_map = as_robot(robot, "read_recording"), reading_beside(source) if columns is None else columns
    heading, reading = read_heading("", 0, (), rate), found_reading(column_map)
    try:
        return replace(_read(source, robot, read_map(column_map, heading=heading), unsigned, topics), reading=reading)
    except RecordingError as error:
        if column_map is not None:
            raise
        drafted = draft_reading(source, robot, topics, error)
    recording = _read(source, robot, read_map(tomllib.loads(drafted.text), heading=heading), unsigned, topics)
    units = {column: unit._replace(by="the reading") for column, unit in recording.units.items()}
    note = f"columns are read by their names and numbers: {shorten([f'{x[0]} from {x[1]}' for x in drafted.rows], 3)}"
    return replace(recording, notes=(note, *recording.notes), units=units, reading=drafted)


def _read(source: Source, robot: Robot, mapping: ParsedColumns, unsigned: bool, topics: Sequence[str]) -> Recording:
    columns_or_path = source if isinstance(source, str | Path) else _by_joint(columns_of(source), robot)
    opened = open_source(columns_or_path, topics, mapping.heading)
    assignment = with_positions(assign_columns(opened, mapping, robot), robot)
    time = assignment.signals.get(("t", 0))
    if mapping.heading.rate is None and not (time and time.mapped):
        used = {signal.column for signal in assignment.signals.values()}
        ask_for_time(opened.table, time.column if time else "", used, opened.name)
    positions = tuple(column for j in range(len(robot.joints)) if (column := assignment.column("q", j)))
    driven = positions and any(map(assignment.torque, range(len(robot.joints))))
    if mapping.heading.rate is None and driven and are_postures(assignment.table, positions, assignment.column("t", 0)):
        named = {key: column for key, column in mapping.named.items() if key != "t"}
        mapping = mapping._replace(named=named, heading=mapping.heading._replace(rate=0.0))
        return _read(source, robot, mapping, unsigned, topics)
    joints = _joints(assignment, robot, opened)
    torques = [assignment.torque(j) for j in joints]
    absolute = [bool(kind) and (unsigned or kind.startswith("abs_")) for kind in torques]
    chosen = {
        "t": (assignment.column("t", 0),),
        "tau": tuple(assignment.column(kind, j) for kind, j in zip(torques, joints, strict=True)),
        **{key: tuple(assignment.column(key, j) for j in joints) for key in POSITIONS},
        **{key: tuple(assignment.column(key, j) for j in joints) for key in ServoSamples._fields},
    }
    _check_samples(assignment.table, opened.name, chosen, torques)
    chosen, dropped = drop_implausible(assignment.table, chosen)
    flags = () if any(torques) else tuple(dropped)
    constants = _torque_constants(robot, mapping.constants, joints, torques, absolute, source=opened.name)
    absolutes = {c: lambda values, _: np.abs(values) for c in chosen["tau"] if unsigned and c}
    recording = Recording(
        tuple(robot.joints[j] for j in joints),
        DerivedTable(assignment.table, absolutes) if absolutes else assignment.table,
        chosen,
        np.where(np.isnan(constants), 1.0, constants),
        ~np.array(absolute),
        opened.path,
        opened.sha256,
        (
            *About.of(opened.table).notes,
            *_notes(assignment, robot, joints, opened, {x for group in chosen.values() for x in group}),
            *assignment.notes,
            *(() if flags else dropped),
        ),
        ~np.isnan(constants) if np.isnan(constants).any() else None,
        (*assignment.flags, *flags),
        {name: unit for name, unit in assignment.units.items() if any(name in group for group in chosen.values())},
    )
    recording = without_dead_torques(recording)
    recording = at_rest(recording) if mapping.heading.rate == 0 else bridge(with_repaired_stamps(recording))
    commands = commanded_torques(recording) if any(chosen["q_des"]) else ()
    return replace(recording, notes=(*recording.notes, *commands))


def same_joints(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Joints of recordings that all have the same ones.

    Raises:
        RecordingError: two recordings have different joints.
    """
    first = recordings[0]
    for other in recordings[1:]:
        for here, there in ((first, other), (other, first)):
            if extra := [joint for joint in here.joints if joint not in there.joints]:
                fault = f"{here.path or 'one recording'} moves {', '.join(extra)}, {there.path or 'another'} does not"
                raise RecordingError(f"{fault}; use only recordings of the same joints together")
    return first.joints


def need_constants(recordings: Sequence[Recording]) -> None:
    """Reject recordings of currents without a torque constant.

    Raises:
        RecordingError: unknown torque constant.
    """
    for recording in recordings:
        if recording.scaled is not None and not recording.scaled.all():
            names = [joint for joint, known in zip(recording.joints, recording.scaled, strict=True) if not known]
            source, advice = recording.path or "the recording", "let identification estimate it"
            raise RecordingError(_no_constant(source, names, advice))


def need_torque(recordings: Sequence[Recording]) -> None:
    """Reject recordings of servos, which have commanded positions and no torque.

    Raises:
        RecordingError: a recording has no torque of any joint.
    """
    for recording in recordings:
        if not any(recording.columns["tau"]):
            source, joint = recording.path or "the recording", recording.joints[0]
            fault = f"{source} has commanded and measured positions, but no torque of a joint"
            raise RecordingError(f"{fault}; add columns such as tau_{joint} or current_{joint}")


def with_signs(recording: Recording, signs: NDArray[np.int8] | NDArray[np.float32]) -> Recording:
    """Apply signs to the absolute torques of a recording; signed torques are unchanged.

    signs: (rows, n) of each row of the file: -1, 1, or between for expected torques; 0 where unknown, which makes NaN.

    Raises:
        RecordingError: the signs do not have one value per row and joint.
    """
    shape = len(recording), len(recording.joints)
    if signs.shape != shape:
        fault = f"{recording.path or 'the recording'} has {shape[0]} rows of {shape[1]} joints"
        raise RecordingError(f"{fault}, the signs have the shape {signs.shape}; give a sign for each row and joint")
    columns = recording.columns["tau"]
    unsigned = np.flatnonzero(~recording.signed).tolist()
    table = DerivedTable(recording.table, {columns[j]: partial(_apply, signs[:, j]) for j in unsigned})
    return replace(recording, table=table, signed=np.ones(shape[1], dtype=bool))


def _apply(signs: NDArray[Any], values: Array, start: int) -> Array:
    sign = signs[start : start + len(values)]
    return np.where(sign == 0, np.nan, np.abs(values) * sign)


def _by_joint(source: Mapping[str, ArrayLike], robot: Robot) -> Mapping[str, ArrayLike]:
    """Split matrices with a column per joint into columns by joint number; other arrays are unchanged."""
    columns: dict[str, ArrayLike] = {}
    for key, value in source.items():
        try:
            shape = np.shape(value)
        except ValueError:
            raise RecordingError(
                f"rows of {key} have different lengths; give one number a row, or one for each joint"
            ) from None
        if len(shape) == 2 and shape[1] == len(robot.joints):
            columns |= {f"{key}_{j}": part for j, part in zip(robot.numbers, np.transpose(value), strict=True)}
        else:
            columns[key] = value
    return columns


def _joints(found: Assignment, robot: Robot, opened: Opened) -> list[int]:
    """Joints with a position column."""
    joints = [j for j in range(len(robot.joints)) if found.column("q", j)]
    advice = "add it, or name it in a column map (--columns)"
    if not found.column("t", 0):
        lack = (
            f"column 't' of time in seconds; {lacking_time(opened.table, {s.column for s in found.signals.values()})}"
        )
    elif not joints:
        lack = f"position column such as q_{robot.joints[0]} or q_{robot.numbers[0]}; {advice}"
    elif not any(found.torque(j) or found.column("q_des", j) for j in joints):
        example = " or ".join(f"{kind}_{robot.numbers[joints[0]]}" for kind in TORQUES)
        lack = f"torque of a joint whose position it has; add columns such as {example}"
        lack += "; a voltage is no torque" if any(found.column("volt", j) for j in joints) else ""
    else:
        return joints
    raise RecordingError(f"{opened.name} has no {lack}")


def _check_samples(table: Table, source: str, chosen: Mapping[str, tuple[str, ...]], torques: Sequence[str]) -> None:
    used = [column for group in chosen.values() for column in group if column]
    table.read(used, 0, 0)  # raises if a column is not numeric
    if not table.rows:
        raise RecordingError(f"{source} has a header but no samples; record the robot in motion")
    names = [column for column, kind in zip(chosen["tau"], torques, strict=True) if kind.startswith("abs_")]
    for start in range(0, table.rows if names else 0, CHUNK):
        rows, columns = np.nonzero(table.read(names, start, start + CHUNK) < 0)
        if len(rows):
            name, row = names[columns[0]], start + rows[0] + 1
            advice = "absolute values are not; name the column tau_ or current_ if it has a sign"
            raise RecordingError(f"{source}: {name} is negative in row {row}; {advice}")


def _torque_constants(
    robot: Robot,
    stated: Mapping[str, float],
    joints: Sequence[int],
    torques: Sequence[str],
    absolute: Sequence[bool],
    *,
    source: str,
) -> Array:
    """Torque constants (n,), 1 where torque is recorded; NaN where the constant of a current is unknown.

    Those `stated` in the reading, by joint, take the place of those of the actuators file.
    """
    if strange := [name for name in stated if name not in robot.joints]:
        raise RecordingError(f"the reading of {source} has a torque constant of {strange[0]}, no joint of {robot.name}")
    current, known = np.array([kind.endswith("current") for kind in torques]), robot.actuators.torque_constant
    constants = [stated.get(robot.joints[j], known[j]) for j in joints]
    values = np.where(current, constants, 1.0)
    if (values == 0).any():
        names = [robot.joints[j] for j, zero in zip(joints, values == 0, strict=True) if zero]
        raise RecordingError(_no_constant(source, names, "leave it out, so that identification can estimate it"))
    return np.where(absolute, np.abs(values), values)


def _no_constant(source: str, names: Sequence[str], advice: str) -> str:
    lone = len(names) == 1
    fact = "the current of {}, but its torque constant is" if lone else "currents of {}, but their torque constants are"
    state = "state torque_constant [N.m/A at the joint, N/A at a prismatic one] in an actuators file"
    return f"{source} records {fact.format(shorten(names))} not known; {state}, or {advice}"


def _notes(
    assignment: Assignment, robot: Robot, joints: Sequence[int], opened: Opened, used: Collection[str]
) -> Iterator[str]:
    """Deviations from what a user may expect; used: the columns that are read."""
    if not any(assignment.torque(j) for j in joints):
        yield "no torque and no current: a recording of servos"
    if absent := [f"{name} (at {x:.4g})" for name, x in resting(robot, [robot.joints[j] for j in joints]).items()]:
        subject, verbs = ("joint", ("has", "is")) if len(absent) == 1 else ("joints", ("have", "are"))
        fact = f"{subject} {', '.join(absent)} {verbs[0]} no position column and {verbs[1]} held fixed"
        others = [x for x in opened.table.columns if x not in used]
        yield f"{fact}; unused columns: {shorten(others, 4)}" if others else fact
    for kind, other in ((a, b) for i, a in enumerate(TORQUES) for b in TORQUES[i + 1 :]):
        if both := [robot.joints[j] for j in joints if assignment.torque(j) == kind and assignment.column(other, j)]:
            yield f"{kind} is used instead of {other}, because both are recorded: {', '.join(both)}"


def drop_implausible(table: Table, chosen: dict[str, tuple[str, ...]]) -> tuple[dict[str, tuple[str, ...]], list[str]]:
    """Columns without those of drives whose numbers cannot be meant, and a note for each of these."""
    chosen, notes = dict(chosen), []
    for key, (low, high, expected) in PLAUSIBLE.items():
        names = [name for name in chosen[key] if name]
        pieces = (table.read(names, start, start + CHUNK) for start in range(0, table.rows if names else 0, CHUNK))
        ends = [(np.nanmin(x, axis=0, initial=0.0), np.nanmax(x, axis=0, initial=0.0)) for x in pieces]
        for k, name in enumerate(names):
            least, greatest = min(float(a[k]) for a, _ in ends), max(float(b[k]) for _, b in ends)
            if least < low or greatest > high:
                chosen[key] = tuple("" if column == name else column for column in chosen[key])
                wrapped = key == "pwm" and least >= 0 and _wrapped(table, name, greatest)
                fact = f"column {name!r} goes from {least:.4g} to {greatest:.4g} and is ignored"
                notes.append(f"{fact}; {UNWRAP if wrapped else f'expected {expected}'}")
    return chosen, notes


def _wrapped(table: Table, name: str, largest: float) -> bool:
    """Whether values are small or nearly the largest: negative numbers that were read as unsigned ones."""
    values = table.read([name], 0, min(table.rows, CHUNK))[:, 0]
    known = values[np.isfinite(values)]
    small = known[known <= MIDDLE * largest]
    large = known >= (1 - MIDDLE) * largest
    return bool(len(small) and large.any() and len(small) + large.sum() == len(known) and small.max() <= 1.01)


def as_recordings(given: object, robot: Robot, verb: str) -> list[Recording]:
    """Recordings of a robot; paths, arrays by column name and frames are read with the usual column names.

    Raises:
        OptionError: anything else was given to the verb.
        RecordingError: a file cannot be read.
    """
    several = isinstance(given, Sequence | Iterator) and not isinstance(given, str | bytes)
    recordings = []
    for recording in given if several else [given]:  # type: ignore[attr-defined]
        if not (isinstance(recording, Recording) or _is_source(recording)):
            advice = 'signid.read_recording("recording.csv", robot)'
            raise unexpected(verb, "a Recording or a list of them", recording, advice)
        recordings.append(recording if isinstance(recording, Recording) else read_recording(recording, robot))
    return recordings


def as_recording(recording_or_source: object, robot: Robot, verb: str) -> Recording:
    """Return the only recording that is given.

    Raises:
        OptionError: anything else, or several recordings were given to the verb.
    """
    recordings = as_recordings(recording_or_source, robot, verb)
    if len(recordings) != 1:
        raise OptionError(f"{verb} needs one recording, not {len(recordings)}; give one of them")
    return recordings[0]


def _is_source(source: Any) -> bool:
    if isinstance(source, np.ndarray):
        return source.dtype.names is not None
    frame = hasattr(source, "iloc") or hasattr(source, "__arrow_c_stream__") or isinstance(source, pl.LazyFrame)
    return frame or isinstance(source, str | Path | Mapping)


def is_recording(name: str) -> bool:
    """Whether a file or folder of that name exists and has the format of a recording."""
    path = Path(name)
    if not path.exists() or path.name.lower().endswith(DESCRIPTIONS):
        return False
    if path.suffix.lower() == ".json" and not holds_samples(path):
        return False
    return path.name.lower().endswith(PICKLED) or any(FORMATS[name].recognises(path) for name in FORMATS.names)


def read_bare(
    source: Source, *, columns: ColumnMap | None = None, topics: Sequence[str] = (), rate: float | None = None
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
    column_map = reading_beside(source) if columns is None else columns
    mapping = read_map(column_map, heading=read_heading("", 0, (), rate))
    opened = open_source(source, topics, mapping.heading)
    signals = _signals(opened, mapping)
    guessed = {} if columns is not None or _commanded(signals) else _guessed_columns(opened.table.columns)
    if guessed:
        mapping = read_map(guessed, mapping.units, mapping.heading)
        signals = _signals(opened, mapping)
    joints = _commanded(signals)
    have = f"it has {shorten(opened.table.columns, 12)}"
    advice = "name them in a column map (--columns), or give the description of the robot before the recording"
    if "t" not in signals:
        time = lacking_time(opened.table, {signal.column for name, signal in signals.items() if split(name)})
        raise RecordingError(f"{opened.name} has no column 't' of time in seconds; {have}; {time}")
    if not joints:
        torque = any(name.startswith(tuple(f"{kind}_" for kind in TORQUES)) for name in signals)
        also = "; a recording of torque needs a description: signid check ROBOT RECORDING" if torque else ""
        raise RecordingError(f"{opened.name} has no joint J with both columns q_J and q_des_J; {have}; {advice}{also}")
    if mapping.heading.rate is None and not signals["t"].mapped:
        ask_for_time(opened.table, "t", {each.column for name, each in signals.items() if split(name)}, opened.name)
    columns_of_joints = {name: signal.column for name, signal in signals.items()}
    chosen = {kind: tuple(columns_of_joints.get(f"{kind}_{joint}", "") for joint in joints) for kind in KINDS}
    listed = [(kind, signal, None) for kind, j in product(KINDS, joints) if (signal := signals.get(f"{kind}_{j}"))]
    table = converted(opened, mapping, [("t", signals["t"], None), *listed], strict=False)
    bare = About.of(opened.table).unstated
    positions = {joint: signals[f"q_{joint}"] for joint in joints}
    stated = {q.column for q in positions.values() if q.unit or (q.mapped and mapping.own.get(q.logical))}
    unknown = [] if "q" in mapping.units else [j for j, q in positions.items() if q.column not in stated]
    unknown = [joint for joint in unknown if guessed or positions[joint].column in bare]
    used = [signals["t"].column, *(name for names in chosen.values() for name in names if name)]
    table.read(used, 0, 0)  # raises if a column is not numeric
    plain, implausible = drop_implausible(table, chosen)
    units = stated_units(mapping, ((split(name)[0][0] if split(name) else "t", each) for name, each in signals.items()))
    units = {name: unit._replace(by="its name") if guessed else unit for name, unit in units.items() if name in used}
    caveats = unit_caveats(opened, units)
    if unknown and bare:
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
    return bridge(with_repaired_stamps(recording)), {joint: "" if joint in unknown else "rad" for joint in joints}


def _signals(opened: Opened, mapping: ParsedColumns) -> dict[str, Signal]:
    return {signal.logical: signal for signal in mapping.signals(opened.table.columns, opened.name)}


def _commanded(signals: Mapping[str, Signal]) -> tuple[str, ...]:
    """Joints with a position and a command, in the order of the columns."""
    joints = [token for name in signals for kind, token in split(name)[:1] if kind == "q"]
    return tuple(joint for joint in joints if f"q_des_{joint}" in signals)


def _guessed_columns(columns: Sequence[str]) -> dict[str, str | dict[str, str]]:
    """Entries of a column map of commanded and measured positions by the words of their names; {} without both."""
    guesses = [guessed for column in columns if (guessed := guess(column)) and not guessed.desired]
    entries: dict[str, str | dict[str, str]] = {}
    for guessed in guesses:
        key = "t" if guessed.kind == "t" else f"{guessed.kind}_{guessed.joint or 'joint'}"
        entries.setdefault(key, {"column": guessed.column, "unit": guessed.unit} if guessed.unit else guessed.column)
    both = any(key.startswith("q_des_") and f"q_{key[6:]}" in entries for key in entries)
    return entries if both and "t" in entries else {}
