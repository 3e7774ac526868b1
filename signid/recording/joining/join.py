"""Open several files of a log as one table on the times of one of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...errors import OptionError, RecordingError, shorten
from ...types import Array
from ..formats import find_format
from ..formats.base import About, Format, MemoryTable, require_memory
from ..names.mapping import ParsedColumns
from ..source import Opened, Source, open_source
from ..streams import TimedColumns, at_times
from .files import Files, JoinedFile, NamedColumn, Timed, in_one_unit, name_columns, read_times
from .offsets import Offset, Readings, estimate_offset

SHIFT_DEVIATIONS = 3.0  # [std] an offset that is larger is not zero
UNSHIFTED_RATIO = {False: 1.1, True: 1.5}  # residual without a shift over that with it, of measurements and of torques
MIN_OFFSET = {False: 0.5, True: 2.0}  # smallest offset [periods of the slower file], of measurements and of torques
FRICTION = 0.02  # [s] error that friction and other joints may cause in the offset of a torque
MIN_JOINED_SHARE = 0.5  # share of the rows of the first file below which the joined rows are flagged


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
    timed = in_one_unit([read_times(each, mapping, notes) for each in _opened(source, topics, mapping)], notes)
    named = name_columns(timed, mapping, notes)
    base = next((k for k, own in enumerate(named) if any(each.kind == "q" for each in own)), 0)
    order = [base, *(k for k in range(len(timed)) if k != base)]
    parts = [_part(timed[k], named[k]) for k in order]
    offsets = _stated(source, [part.file for part in parts])
    files = [_aligned(parts, k, offsets, source.align, notes, flags) for k in range(1, len(parts))]
    for k, file in enumerate(files, 1):
        parts[k] = parts[k].moved(file.offset)
    return _table(parts, files, mapping, notes, flags)


class _Part(NamedTuple):
    file: Timed
    columns: Mapping[str, Array]  # (N,) by joined name
    named: Sequence[NamedColumn]
    unusable: Mapping[str, str]

    def moved(self, seconds: float) -> _Part:
        return self._replace(file=self.file._replace(t=self.file.t + round(seconds * 1e9)))

    def stream(self) -> TimedColumns:
        wraps = {
            each.name: 0.8 * float(np.nanmax(values) - np.nanmin(values)) if np.isnan(each.wrap) else each.wrap
            for each in self.named
            if (values := self.columns.get(each.name)) is not None and np.isfinite(values).any()
        }
        return TimedColumns(self.file.name, self.file.t, self.columns, wraps, "row")

    def tracks(self, since: int) -> dict[tuple[str, str], Readings]:
        t = (self.file.t - since) / 1e9
        found = {}
        for each in self.named:
            if each.kind and (values := self.columns.get(each.name)) is not None:
                known = np.isfinite(values)
                found[each.kind, each.joint] = Readings(t[known], values[known])
        return found


def _opened(source: Files, topics: Sequence[str], mapping: ParsedColumns) -> list[Opened]:
    paths = [Path(path) for path in source.paths]
    if twice := next(
        (path for k, path in enumerate(paths) if path.resolve() in [p.resolve() for p in paths[:k]]), None
    ):
        raise OptionError(f"{twice} is given twice; give each file of the log once")
    with_topics = [path.exists() and type(find_format(path)).select is not Format.select for path in paths]
    if topics and not any(with_topics):
        raise OptionError(f"none of {shorten([str(path) for path in paths])} has topics; remove --topic")
    found = []
    for path, has in zip(paths, with_topics, strict=True):
        opened = open_source(path, topics if has else (), mapping.heading)
        require_memory(path, 24.0 * opened.table.rows * len(opened.table.columns), "join shorter files")
        found.append(opened)
    return found


def _part(file: Timed, named: Sequence[NamedColumn]) -> _Part:
    columns, unusable = {}, {}
    for each in named:
        try:
            columns[each.name] = file.values(each.column)
        except RecordingError:
            unusable[each.name] = "holds no numbers"
    return _Part(file, columns, named, unusable)


def _stated(source: Files, files: Sequence[Timed]) -> dict[int, float]:
    """Stated offsets [s] by file, relative to the first of `files`.

    Raises:
        OptionError: an offset of no file, or of two.
    """
    found: dict[int, float] = {}
    for given, seconds in source.offsets.items():
        paths = [file.opened.path for file in files]
        mine = [k for k, path in enumerate(paths) if Path(path) == Path(given)]
        mine = mine or [k for k, path in enumerate(paths) if Path(path).name == given]
        if len(mine) != 1:
            fault = "is none of the files" if not mine else "is the name of several files"
            raise OptionError(f"--offset {given}={seconds:g}: {given} {fault}; give one of {shorten(paths)}")
        found[mine[0]] = seconds
    if found and (own := found.pop(0, 0.0)):
        found = {k: found.get(k, 0.0) - own for k in range(1, len(files))}
    return found


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
    found = estimate_offset(parts[0].tracks(int(first.t[0])), parts[k].tracks(since), max(0.0, overlap))
    shift = 0.0 if isinstance(found, str) else found.shift.seconds
    if apart:
        if isinstance(found, str):
            raise RecordingError(_unknown(first, other, found))
        total = shift + (int(first.t[0]) - since) / 1e9
        said = (
            f"{other.name}: its clock and that of {first.name} do not overlap; {_number(total, found)} is added to its"
        )
        said += f" times, as {_basis(found)} shows"
        if found.command:
            flags.append(f"{said}; the lag of the servo cannot be distinguished from it and is removed with it")
        else:
            notes.append(said)
        return JoinedFile(path, digest, total, total, found.shift.std)
    if isinstance(found, str):
        notes += [f"{other.name}: its clock is used as it is (--align: {found})"] if align else []
        return JoinedFile(path, digest, 0.0, None, None)
    used = _judged(first, other, found, align, notes, flags)
    if used is None:
        return JoinedFile(path, digest, 0.0, None, None)
    return JoinedFile(path, digest, used, shift, found.shift.std)


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


def _number(seconds: float, found: Offset) -> str:
    digits = max(0, min(6, 1 - int(np.floor(np.log10(max(found.shift.std, 1e-6))))))
    return f"{seconds:.{digits}f} s (std {found.shift.std:.2g} s)"


def _basis(found: Offset) -> str:
    pairs = list(found.pairs)
    return f"the comparison of {shorten(pairs, 2)}"


def _unknown(first: Timed, other: Timed, why: str) -> str:
    spans = [f"{file.name} {file.t[0] / 1e9:.10g} to {file.t[-1] / 1e9:.10g} s" for file in (first, other)]
    start = (int(first.t[0]) - int(other.t[0])) / 1e9
    name = Path(other.opened.path).name
    mend = f"state what is to be added to the times of {name} with --offset {name}=SECONDS"
    return (
        f"the times of {' and '.join(spans)} do not overlap, and the offset of their clocks cannot be estimated, "
        f"because {why}; {mend} ({start:.10g} lets both begin together)"
    )


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
    notes += _lacking(parts, columns, inside)
    about = [About.of(each.table) for each in opened]
    unstated = {
        each.name for part in parts for each in part.named if each.column in About.of(part.file.opened.table).unstated
    }
    merged = About(
        tuple(dict.fromkeys([*(note for each in about for note in each.notes), *notes])),
        frozenset(unstated),
        tuple(topic for each in about for topic in each.topics),
        about[0].clock,
    )
    name = " + ".join(each.name for each in opened)
    unusable = {name: why for part in parts for name, why in part.unusable.items()}
    table = MemoryTable({"t": base.file.seconds[inside], **columns}, unusable, name, merged)
    own = {key: each for key, each in mapping.own.items() if key != "t"}
    units = {kind: unit for kind, unit in mapping.units.items() if kind != "t"}
    named = {key: column for key, column in mapping.named.items() if key != "t"}
    plain = mapping._replace(named=named, own=own, units=units)
    joined = Opened(table, name, opened[0].path, opened[0].sha256)
    return Joined(joined, plain, tuple(files), tuple(flags))


def _lacking(parts: Sequence[_Part], columns: Mapping[str, Array], inside: slice) -> list[str]:
    """Notes on rows at which other files have no values, because of a gap or a missing value."""
    found = []
    for part in parts[1:]:
        own = [columns[each.name] for each in part.named if each.name in columns]
        lacking = int(np.isnan(own).any(axis=0).sum()) if own else 0
        found += [f"{part.file.name}: {lacking} joined rows lack a value of it"] if lacking else []
    return found
