"""Files to join, the clock of each, and the names that their columns have in one table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...errors import RecordingError, shorten
from ...types import Array
from ..formats.base import About
from ..names.mapping import ParsedColumns, Signal, split
from ..names.match import Guess, guess
from ..names.vocabulary import Change, change_of
from ..sampling.clock import ask_for_time
from ..source import Opened
from ..streams import WRAP, Stamps, plural
from ..units import time_unit

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
    column, unit, mapped = _time_column(opened, mapping)
    if mapping.heading.rate is None and not mapped:
        ask_for_time(table, column, {each for each in table.columns if split(each)}, name)
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
    found = []
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
        found.append(file)
    return found


def _time_column(opened: Opened, mapping: ParsedColumns) -> tuple[str, str, bool]:
    """Column of time, its unit as its name or the map states it, and whether the map names it."""
    columns = opened.table.columns
    signals = list(own_columns(mapping, opened).signals(columns, opened.name))
    if stated := next((each for each in signals if each.logical == "t"), None):
        return stated.column, stated.unit, stated.mapped
    found = [one for column in columns if (one := guess(column)) and one.kind == "t"]
    if not found:
        advice = 'name it in a column map (--columns): t = "NAME"'
        raise RecordingError(f"{opened.name} has no column of time; it has {shorten(columns, 12)}; {advice}")
    return found[0].column, found[0].unit, False


def _change(raw: Array, named: str, name: str, column: str, mapping: ParsedColumns, notes: list[str]) -> Change:
    """Conversion of times (N,) [any unit] to seconds; a unit in the name of the column is nearest to the file."""
    own = mapping.own.get("t") if mapping.named.get("t") == column else None
    if isinstance(own, Change):
        return own
    stated = mapping.units.get("t", "")
    unit = named or own or ("" if stated == "s" else stated)
    noticed = time_unit(raw, unit)
    if not unit and noticed.unit != "s":
        notes.append(f"{name}: time {column!r} is read in {noticed.unit}, because it {noticed.why}")
    return change_of(str(noticed.unit), "t", None, f"{name}: column {column!r}")


def stems(files: Sequence[Timed]) -> list[str]:
    """Name that each file gives its joint: its own without the ending, or that of its folder if the files share it."""
    paths = [Path(each.opened.path) for each in files]
    own = [Path(path.name.removesuffix(".gz")).stem for path in paths]
    folders = [path.resolve().parent.name for path in paths]
    return own if len({*own}) == len(own) or len({*folders}) < len(own) else folders


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
    bare = [{s.column: one for s in own if not s.mapped and (one := _without_joint(s.column))} for own in signals]
    kinds = [{(one.kind, one.desired) for one in own.values()} for own in bare]
    found: list[list[NamedColumn]] = []
    for k, (file, stem) in enumerate(zip(files, stems(files), strict=True)):
        others = set().union(*(kinds[:k] + kinds[k + 1 :]))
        own = bare[k] if kinds[k] & others else {}
        found.append([_named(signal, own.get(signal.column), stem, mapping) for signal in signals[k]])
        if own:
            notes.append(f"{file.name}: columns without a joint in their names are those of the joint {stem}")
    return _distinct(files, found)


def _without_joint(column: str) -> Guess | None:
    """Meaning of a column whose name has a kind of signal and no joint; None for others."""
    one = guess(f"{ANY} {column}")
    return one if one and one.joint == ANY and one.kind != "t" and not one.bare else None


def _named(signal: Signal, bare: Guess | None, stem: str, mapping: ParsedColumns) -> NamedColumn:
    if bare is not None:
        unit = f" [{bare.unit}]" if bare.unit else ""
        unclear = bare.desired or bare.counts or bare.load  # no signal of a known unit; its name keeps the words
        name = f"{stem} {signal.column}" if unclear else f"{bare.kind}_{stem}{unit}"
        kind = "" if bare.desired else bare.kind
        return NamedColumn(signal.column, name, kind, stem, _wrap(kind, bare.unit, mapping, None))
    own = mapping.own.get(signal.logical) if signal.mapped else None
    if pairs := split(signal.logical):
        return NamedColumn(signal.column, signal.column, *pairs[0], _wrap(pairs[0][0], signal.unit, mapping, own))
    one = guess(signal.column)
    if one is None or one.desired or one.kind == "t":
        return NamedColumn(signal.column, signal.column, "", "")
    wrap = _wrap(one.kind, one.unit, mapping, None) if one.unit or one.kind in mapping.units else float("nan")
    return NamedColumn(signal.column, signal.column, one.kind, one.joint, wrap)


def _wrap(kind: str, unit: str, mapping: ParsedColumns, own: str | Change | None) -> float:
    """Jump of a position that is a wrap of its encoder [unit of the column]; infinite for other kinds."""
    if kind not in ("q", "q_des"):
        return float("inf")
    stated = own or mapping.units.get(kind) or unit or "rad"
    change = stated if isinstance(stated, Change) else change_of(stated, kind, None, "the column map")
    return WRAP * change.over / abs(change.scale) if change.scale else float("inf")


def _distinct(files: Sequence[Timed], found: list[list[NamedColumn]]) -> list[list[NamedColumn]]:
    """Columns with different names: the same signal twice is an error, other columns get the name of their file."""
    first: dict[str, tuple[Timed, str]] = {}
    for file, own in zip(files, found, strict=True):
        for each in own:
            for key in (f"{each.kind}_{each.joint}",) if each.kind else ():
                if key in first and first[key][0] is not file:
                    both = f"{first[key][0].name} and {file.name} both have the signal {key}"
                    names = f"columns {first[key][1]!r} and {each.column!r}"
                    raise RecordingError(f"{both} ({names}); leave it out of one file, or rename its joint")
                first[key] = file, each.column
    all_names = [each.name for own in found for each in own]
    return [
        [each._replace(name=f"{each.name} of {stem}") if all_names.count(each.name) > 1 else each for each in own]
        for own, stem in zip(found, stems(files), strict=True)
    ]
