"""Names that the columns of several files have in one table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ...errors import RecordingError
from ..names.mapping import ParsedColumns, Signal, split
from ..names.match import Guess, guess
from ..names.units import Change, change_of
from ..streams import WRAP
from .files import Timed, own_columns, stems

ANY = "x"  # a joint without a name


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
    signals = [_signals(file, mapping) for file in files]
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


def _signals(file: Timed, mapping: ParsedColumns) -> list[Signal]:
    own = own_columns(mapping, file.opened)
    return [s for s in own.signals(file.opened.table.columns, file.name) if s.column != file.column]


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
