"""Logs that come as several files, one a joint or a quantity, each with its own clock: join them on time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import OptionError, RecordingError, shorten
from ..types import Array
from .columns import time_unit
from .formats import find_format
from .formats.base import About, Format, MemoryTable, require_memory
from .mapping import ParsedColumns, Signal, split
from .match import Guess, guess
from .sampling.clock import ask_for_time
from .source import Opened, Source, open_source
from .streams import WRAP, Offset, Readings, Stamps, TimedColumns, at_times, estimate_offset, plural
from .vocabulary import Change, change_of

SHIFT_DEVIATIONS = 3.0  # [std] an offset that is larger is not zero
UNSHIFTED_RATIO = {False: 1.1, True: 1.5}  # residual without a shift over that with it, of measurements and of torques
MIN_OFFSET = {False: 0.5, True: 2.0}  # smallest offset [periods of the slower file], of measurements and of torques
FRICTION = 0.02  # [s] error that friction and other joints may cause in the offset of a torque
MIN_JOINED_SHARE = 0.5  # share of the rows of the first file below which the joined rows are flagged
BACK = 10.0  # a larger step back is no disorder of rows, but another clock [periods]
SMALLER = {"ms": 1e3, "us": 1e6, "ns": 1e9}  # units of time in a second
LENGTH_TOLERANCE = 0.1  # share by which the lengths of files may differ for their units to be compared
MAX_TIME = 9e9  # [s] latest time; int64 holds it in nanoseconds
ANY = "x"  # a joint without a name


class Files(NamedTuple):
    """Files of one log."""

    paths: tuple[str | Path, ...]
    offsets: Mapping[str, float] = {}  # [s] that are added to the times of a file, by its path or name
    align: bool = False  # whether offsets of clocks that overlap are estimated and removed


class JoinedFile(NamedTuple):
    """A file that was joined to the first, and its clock."""

    path: str
    sha256: str
    offset: float  # [s] that was added to its times
    estimate: float | None  # [s] offset that its columns show
    std: float | None  # [s] of the estimate


class Joined(NamedTuple):
    """An opened source, and what joining its files found; a single source is as it was opened."""

    opened: Opened
    mapping: ParsedColumns  # without the column of time, which is t [s]
    files: tuple[JoinedFile, ...] = ()  # besides the first
    flags: tuple[str, ...] = ()


def open_files(source: Source | Files, topics: Sequence[str], mapping: ParsedColumns) -> Joined:
    """Open a source, or files of one log that are joined on time; `topics` are those of the bags among them.

    The first file with positions gives the rows. Columns of the others are interpolated there, never across gaps. Files
    whose times do not overlap get the offset that is stated, or estimated from signals of the same joint.

    Raises:
        OptionError: an offset of no file, or topics of files without topics.
        RecordingError: a source cannot be read, two files have the same signal, or an offset cannot be estimated.
    """
    if not isinstance(source, Files):
        return Joined(open_source(source, topics, mapping.heading), mapping)
    if len(source.paths) == 1:
        if source.offsets or source.align:
            raise OptionError("--offset and --align are for several files; give a second file, or leave them out")
        return Joined(open_source(source.paths[0], topics, mapping.heading), mapping)
    notes: list[str] = []
    flags: list[str] = []
    paths = [Path(path) for path in source.paths]
    if twice := next(
        (path for k, path in enumerate(paths) if path.resolve() in [p.resolve() for p in paths[:k]]), None
    ):
        raise OptionError(f"{twice} is given twice; give each file of the log once")
    with_topics = [path.exists() and type(find_format(path)).select is not Format.select for path in paths]
    if topics and not any(with_topics):
        raise OptionError(f"none of {shorten([str(path) for path in paths])} has topics; remove --topic")
    opened_files = []
    for path, has in zip(paths, with_topics, strict=True):
        opened = open_source(path, topics if has else (), mapping.heading)
        require_memory(path, 24.0 * opened.table.rows * len(opened.table.columns), "join shorter files")
        opened_files.append(opened)
    timed = in_one_unit([read_times(opened, mapping, notes) for opened in opened_files], notes)
    named = name_columns(timed, mapping, notes)
    base = next((k for k, columns in enumerate(named) if any(column.kind == "q" for column in columns)), 0)
    order = [base, *(k for k in range(len(timed)) if k != base)]
    parts = [_Part.read(timed[k], named[k]) for k in order]
    places = [part.file.opened.path for part in parts]
    offsets: dict[int, float] = {}  # stated ones [s], relative to the first part
    for file_name, seconds in source.offsets.items():
        matching = [k for k, place in enumerate(places) if Path(place) == Path(file_name)]
        matching = matching or [k for k, place in enumerate(places) if Path(place).name == file_name]
        if len(matching) != 1:
            fault = "is none of the files" if not matching else "is the name of several files"
            raise OptionError(f"--offset {file_name}={seconds:g}: {file_name} {fault}; give one of {shorten(places)}")
        offsets[matching[0]] = seconds
    if offsets and (first_offset := offsets.pop(0, 0.0)):
        offsets = {k: offsets.get(k, 0.0) - first_offset for k in range(1, len(parts))}
    files = [_aligned(parts, k, offsets, source.align, notes, flags) for k in range(1, len(parts))]
    for k, file in enumerate(files, 1):
        parts[k] = parts[k].moved(file.offset)
    return _table(parts, files, mapping, notes, flags)


class _Part(NamedTuple):
    file: Timed
    columns: Mapping[str, Array]  # (N,) by joined name
    named: Sequence[NamedColumn]
    unusable: Mapping[str, str]

    @classmethod
    def read(cls, file: Timed, named: Sequence[NamedColumn]) -> _Part:
        columns, unusable = {}, {}
        for column in named:
            try:
                columns[column.name] = file.values(column.column)
            except RecordingError:
                unusable[column.name] = "holds no numbers"
        return cls(file, columns, named, unusable)

    def moved(self, seconds: float) -> _Part:
        return self._replace(file=self.file._replace(t=self.file.t + round(seconds * 1e9)))

    def stream(self) -> TimedColumns:
        wraps = {
            column.name: 0.8 * float(np.nanmax(values) - np.nanmin(values)) if np.isnan(column.wrap) else column.wrap
            for column in self.named
            if (values := self.columns.get(column.name)) is not None and np.isfinite(values).any()
        }
        return TimedColumns(self.file.name, self.file.t, self.columns, wraps, "row")

    def tracks(self, since: int) -> dict[tuple[str, str], Readings]:
        t = (self.file.t - since) / 1e9
        tracks = {}
        for column in self.named:
            if column.kind and (values := self.columns.get(column.name)) is not None:
                known = np.isfinite(values)
                tracks[column.kind, column.joint] = Readings(t[known], values[known])
        return tracks


def _aligned(
    parts: Sequence[_Part], k: int, stated: Mapping[int, float], align: bool, notes: list[str], flags: list[str]
) -> JoinedFile:
    """Offset of a file to the clock of the first, with its note or flag."""
    first, other = parts[0].file, parts[k].file
    path, digest = other.opened.path, other.opened.sha256
    if k in stated:
        notes.append(f"{other.name}: {stated[k]:g} s is added to its times, as stated")
        return JoinedFile(path, digest, stated[k], None, None)
    overlap = (min(first.t[-1], other.t[-1]) - max(first.t[0], other.t[0])) / 1e9
    apart = overlap <= 0
    since = int(other.t[0]) if apart else int(first.t[0])
    offset = estimate_offset(parts[0].tracks(int(first.t[0])), parts[k].tracks(since), max(0.0, overlap))
    shift = 0.0 if isinstance(offset, str) else offset.shift.seconds
    if apart:
        if isinstance(offset, str):
            spans = [f"{file.name} {file.t[0] / 1e9:.10g} to {file.t[-1] / 1e9:.10g} s" for file in (first, other)]
            start, name = (int(first.t[0]) - int(other.t[0])) / 1e9, Path(path).name
            mend = f"state what is to be added to the times of {name} with --offset {name}=SECONDS"
            fact = (
                f"the times of {' and '.join(spans)} do not overlap, and the offset of their clocks cannot be estimated"
            )
            raise RecordingError(f"{fact}, because {offset}; {mend} ({start:.10g} lets both begin together)")
        total = shift + (int(first.t[0]) - since) / 1e9
        fact = f"{other.name}: its clock and that of {first.name} do not overlap"
        fact = f"{fact}; {_number(total, offset)} is added to its times, as {_basis(offset)} shows"
        if offset.command:
            flags.append(f"{fact}; the lag of the servo cannot be distinguished from it and is removed with it")
        else:
            notes.append(fact)
        return JoinedFile(path, digest, total, total, offset.shift.std)
    if isinstance(offset, str):
        notes += [f"{other.name}: its clock is used as it is (--align: {offset})"] if align else []
        return JoinedFile(path, digest, 0.0, None, None)
    used = _judged(first, other, offset, align, notes, flags)
    if used is None:
        return JoinedFile(path, digest, 0.0, None, None)
    return JoinedFile(path, digest, used, shift, offset.shift.std)


def _judged(first: Timed, other: Timed, found: Offset, align: bool, notes: list[str], flags: list[str]) -> float | None:
    """Offset [s] that is applied where clocks overlap; None if the estimate is not clear."""
    shift, slower = found.shift, max(first.period, other.period)
    number, basis = _number(shift.seconds, found), _basis(found)
    least = max(MIN_OFFSET[found.force] * slower, FRICTION if found.force else 0.0, SHIFT_DEVIATIONS * shift.std)
    better = 1 - shift.unshifted > UNSHIFTED_RATIO[found.force] * (1 - shift.explained)
    if found.command:
        if abs(shift.seconds) > least and better:
            meant = "this is the lag of the servo, an offset of the clocks, or both, and is not removed"
            notes.append(f"{other.name}: {basis} shows a shift of {number}; {meant}")
        return 0.0
    if abs(shift.seconds) > least and not better:
        hardly = f"no clear offset to the clock of {first.name}: a shift explains hardly more than none, by {basis}"
        notes += [f"{other.name}: {hardly}; state it with --offset if there is one"] if align else []
        return None
    if abs(shift.seconds) <= least:
        notes += [f"{other.name}: no offset to the clock of {first.name} ({number}, by {basis})"] if align else []
        return 0.0
    if align:
        notes.append(f"{other.name}: {number} is added to its times (--align), as {basis} shows")
        return shift.seconds
    cause = "another clock, or a delay of the measurement"
    mend = f"--align removes it, and --offset {Path(other.opened.path).name}={shift.seconds:.6g} states it"
    flags.append(f"{other.name}: {basis} shows an offset of {number} to {first.name} ({cause}), not removed; {mend}")
    return 0.0


def _number(seconds: float, offset: Offset) -> str:
    digits = max(0, min(6, 1 - int(np.floor(np.log10(max(offset.shift.std, 1e-6))))))
    return f"{seconds:.{digits}f} s (std {offset.shift.std:.2g} s)"


def _basis(offset: Offset) -> str:
    return f"the comparison of {shorten(list(offset.pairs), 2)}"


def _table(
    parts: Sequence[_Part], files: Sequence[JoinedFile], mapping: ParsedColumns, notes: list[str], flags: list[str]
) -> Joined:
    base, opened = parts[0], [part.file.opened for part in parts]
    for part in parts[1:]:
        if part.file.t[0] > base.file.t[-1] or part.file.t[-1] < base.file.t[0]:
            advice = "correct --offset, which is added to its times"
            raise RecordingError(f"{part.file.name} does not overlap {base.file.name} in time; {advice}")
    columns, inside = at_times(base.stream(), [part.stream() for part in parts[1:]], notes, slower=True)
    count = len(base.file.t[inside])
    if count < MIN_JOINED_SHARE * len(base.file.t):
        flags.append(f"{base.file.name}: only {count} of its {len(base.file.t)} rows lie within the times of all files")
    for part in parts[1:]:  # a gap of the other file, or a missing value
        values = [columns[column.name] for column in part.named if column.name in columns]
        lacking = int(np.isnan(values).any(axis=0).sum()) if values else 0
        notes += [f"{part.file.name}: {lacking} joined rows lack a value of it"] if lacking else []
    about = [About.of(file.table) for file in opened]
    pairs = [(column, known) for part, known in zip(parts, about, strict=True) for column in part.named]
    merged = About(
        tuple(dict.fromkeys([*(note for known in about for note in known.notes), *notes])),
        frozenset(column.name for column, known in pairs if column.column in known.unstated),
        tuple(topic for known in about for topic in known.topics),
        about[0].clock,
    )
    name = " + ".join(file.name for file in opened)
    unusable = {name: why for part in parts for name, why in part.unusable.items()}
    table = MemoryTable({"t": base.file.seconds[inside], **columns}, unusable, name, merged)
    own = {key: unit for key, unit in mapping.own.items() if key != "t"}
    units = {kind: unit for kind, unit in mapping.units.items() if kind != "t"}
    named = {key: column for key, column in mapping.named.items() if key != "t"}
    plain = mapping._replace(named=named, own=own, units=units)
    joined = Opened(table, name, opened[0].path, opened[0].sha256)
    return Joined(joined, plain, tuple(files), tuple(flags))


class Timed(NamedTuple):
    """A file and its rows in the order of time."""

    opened: Opened
    column: str  # of time
    t: Stamps  # (N,) [ns] increasing
    rows: np.ndarray  # (N,) their indices in the file
    seconds: Array  # (N,) time of the file [s]
    stated: bool = True  # whether the unit of time is stated

    @property
    def name(self) -> str:
        """Name of the file in messages."""
        return self.opened.name

    @property
    def period(self) -> float:
        """Median time between rows [s]."""
        return float(np.median(np.diff(self.t))) / 1e9

    def values(self, column: str) -> Array:
        """A column (N,) in the order of time.

        Raises:
            RecordingError: the column holds no numbers.
        """
        return np.asarray(self.opened.table.read([column], 0, self.opened.table.rows)[self.rows, 0])


def own_columns(mapping: ParsedColumns, opened: Opened) -> ParsedColumns:
    """A column map without the columns that a file does not have."""
    signals = {key: column for key, column in mapping.named.items() if column in opened.table.columns}
    return mapping._replace(named=signals)


def read_times(opened: Opened, mapping: ParsedColumns, notes: list[str]) -> Timed:
    """Times of a file in nanoseconds; rows are sorted, and those without a time of their own are omitted.

    Raises:
        RecordingError: no column of time, two that disagree, or one that restarts.
    """
    name, table = opened.name, opened.table
    if not table.rows:
        raise RecordingError(f"{name} has columns but no samples; record the robot in motion")
    signals = list(own_columns(mapping, opened).signals(table.columns, name))
    guesses = (meant for column in table.columns if (meant := guess(column)) and meant.kind == "t")
    if stated := next((signal for signal in signals if signal.logical == "t"), None):
        column, unit, mapped = stated.column, stated.unit, stated.mapped
    elif time := next(guesses, None):
        column, unit, mapped = time.column, time.unit, False
    else:
        advice = 'name it in a column map (--columns): t = "NAME"'
        raise RecordingError(f"{name} has no column of time; it has {shorten(table.columns, 12)}; {advice}")
    if mapping.heading.rate is None and not mapped:
        ask_for_time(table, column, {column for column in table.columns if split(column)}, name)
    raw = table.read([column], 0, table.rows)[:, 0]
    since = getattr(table, "since", {}).get(column, 0)
    change = Change() if since else _change(raw, unit, name, column, mapping, notes)
    seconds = change.apply(raw)
    if np.nanmax(np.abs(seconds), initial=0.0) > MAX_TIME:
        raise RecordingError(f"{name}: column {column!r} has times beyond {MAX_TIME:.0e} s; state its unit: t [ns]")
    known = np.flatnonzero(np.isfinite(seconds))
    t = np.rint(seconds[known] * 1e9).astype(np.int64) + since + round(About.of(table).origin * 1e9)
    steps = np.diff(t)
    if not (steps > 0).any():
        raise RecordingError(f"{name}: time {column!r} has fewer than two different values, so it cannot be joined")
    if (steps < -BACK * np.median(steps[steps > 0])).any():
        fault = f"time {column!r} jumps back by {-steps.min() / 1e9:.3g} s after row {known[int(np.argmin(steps))] + 1}"
        raise RecordingError(f"{name}: {fault}; files are joined on one clock each: split it there")
    order = np.argsort(t, kind="stable")
    fresh = np.diff(t[order], prepend=t[order][0] - 1) > 0
    for number, what in (
        (table.rows - len(known), "without a time omitted"),
        (int((steps < 0).sum()), "out of order: sorted by time"),
        (int((~fresh).sum()), "with the time of the previous one: omitted"),
    ):
        notes += [f"{name}: {plural(number, 'row')} {what}"] if number else []
    rows = known[order][fresh]
    sure = bool(since or unit or mapping.units.get("t") or (mapped and "t" in mapping.own))
    return Timed(opened, column, t[order][fresh], rows, seconds[rows], sure)


def in_one_unit(files: Sequence[Timed], notes: list[str]) -> list[Timed]:
    """Files of which those without a stated unit of time are in the unit that makes them as long as the others."""
    shortest = min(files, key=lambda file: np.ptp(file.seconds))
    files_in_unit = []
    for file in files:
        ratio = float(np.ptp(file.seconds) / np.ptp(shortest.seconds))
        unit = next((name for name, times in SMALLER.items() if abs(ratio / times - 1) < LENGTH_TOLERANCE), "")
        if unit and not file.stated:
            times = SMALLER[unit]
            notes.append(
                f"{file.name}: time {file.column!r} is read in {unit}, as {shortest.name} is {times:g} times shorter"
            )
            t = np.rint(file.t / times).astype(np.int64)
            fresh = np.diff(t, prepend=t[0] - 1) > 0
            file = file._replace(t=t[fresh], rows=file.rows[fresh], seconds=file.seconds[fresh] / times)
        files_in_unit.append(file)
    return files_in_unit


def _change(raw: Array, named: str, name: str, column: str, mapping: ParsedColumns, notes: list[str]) -> Change:
    """Conversion of times (N,) [any unit] to seconds; a unit in the name of the column is nearest to the file."""
    map_unit = mapping.own.get("t") if mapping.named.get("t") == column else None
    if isinstance(map_unit, Change):
        return map_unit
    stated = mapping.units.get("t", "")
    unit = named or map_unit or ("" if stated == "s" else stated)
    noticed = time_unit(raw, unit)
    if not unit and noticed.unit != "s":
        notes.append(f"{name}: time {column!r} is read in {noticed.unit}, because it {noticed.why}")
    return change_of(str(noticed.unit), "t", None, f"{name}: column {column!r}")


def stems(files: Sequence[Timed]) -> list[str]:
    """Name that each file gives its joint: its own without the ending, or that of its folder if the files share it."""
    paths = [Path(file.opened.path) for file in files]
    names = [Path(path.name.removesuffix(".gz")).stem for path in paths]
    folders = [path.resolve().parent.name for path in paths]
    return names if len({*names}) == len(names) or len({*folders}) < len(names) else folders


class NamedColumn(NamedTuple):
    """A column of a file, its name in the joined table, and its meaning."""

    column: str
    name: str
    kind: str  # "" if it is no signal
    joint: str
    wrap: float = float("inf")  # a larger jump is a wrap of the encoder [unit of the column]; NaN: unknown


def name_columns(files: Sequence[Timed], mapping: ParsedColumns, notes: list[str]) -> list[list[NamedColumn]]:
    """Names of the columns of each file but those of time.

    Where several files have a column of the same kind whose name says no joint, such as position, each such file is
    that of one joint, which it names: elbow.csv gives q_elbow. Other columns keep their names.

    Raises:
        RecordingError: two files have the same signal.
    """
    own_signals = (own_columns(mapping, file.opened).signals(file.opened.table.columns, file.name) for file in files)
    signals = [[s for s in own if s.column != file.column] for own, file in zip(own_signals, files, strict=True)]
    bare = [{s.column: meant for s in own if not s.mapped and (meant := _without_joint(s.column))} for own in signals]
    kinds = [{(meant.kind, meant.desired) for meant in own.values()} for own in bare]
    columns: list[list[NamedColumn]] = []
    for k, (file, stem) in enumerate(zip(files, stems(files), strict=True)):
        others = set().union(*(kinds[:k] + kinds[k + 1 :]))
        own = bare[k] if kinds[k] & others else {}
        columns.append([_named(signal, own.get(signal.column), stem, mapping) for signal in signals[k]])
        if own:
            notes.append(f"{file.name}: columns without a joint in their names are those of the joint {stem}")
    first: dict[str, tuple[Timed, str]] = {}
    for file, group in zip(files, columns, strict=True):
        for column in group:
            for key in (f"{column.kind}_{column.joint}",) if column.kind else ():
                if key in first and first[key][0] is not file:
                    both = f"{first[key][0].name} and {file.name} both have the signal {key}"
                    names = f"columns {first[key][1]!r} and {column.column!r}"
                    raise RecordingError(f"{both} ({names}); leave it out of one file, or rename its joint")
                first[key] = file, column.column
    all_names = [column.name for group in columns for column in group]
    return [
        [
            column._replace(name=f"{column.name} of {stem}") if all_names.count(column.name) > 1 else column
            for column in group
        ]
        for group, stem in zip(columns, stems(files), strict=True)
    ]


def _without_joint(column: str) -> Guess | None:
    """Meaning of a column whose name has a kind of signal and no joint; None for others."""
    guessed = guess(f"{ANY} {column}")
    return guessed if guessed and guessed.joint == ANY and guessed.kind != "t" and not guessed.bare else None


def _named(signal: Signal, bare: Guess | None, stem: str, mapping: ParsedColumns) -> NamedColumn:
    if bare is not None:
        unit = f" [{bare.unit}]" if bare.unit else ""
        unclear = bare.desired or bare.counts or bare.load  # no signal of a known unit; its name keeps the words
        name = f"{stem} {signal.column}" if unclear else f"{bare.kind}_{stem}{unit}"
        kind = "" if bare.desired else bare.kind
        return NamedColumn(signal.column, name, kind, stem, _wrap(kind, bare.unit, mapping, None))
    in_map = mapping.own.get(signal.logical) if signal.mapped else None
    if pairs := split(signal.logical):
        return NamedColumn(signal.column, signal.column, *pairs[0], _wrap(pairs[0][0], signal.unit, mapping, in_map))
    meant = guess(signal.column)
    if meant is None or meant.desired or meant.kind == "t":
        return NamedColumn(signal.column, signal.column, "", "")
    wrap = _wrap(meant.kind, meant.unit, mapping, None) if meant.unit or meant.kind in mapping.units else float("nan")
    return NamedColumn(signal.column, signal.column, meant.kind, meant.joint, wrap)


def _wrap(kind: str, unit: str, mapping: ParsedColumns, map_unit: str | Change | None) -> float:
    """Jump of a position that is a wrap of its encoder [unit of the column]; infinite for other kinds."""
    if kind not in ("q", "q_des"):
        return float("inf")
    stated = map_unit or mapping.units.get(kind) or unit or "rad"
    change = stated if isinstance(stated, Change) else change_of(stated, kind, None, "the column map")
    return WRAP * change.over / abs(change.scale) if change.scale else float("inf")
