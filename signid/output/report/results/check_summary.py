"""Description of a check in both modes, as terminal text and JSON: sampling, units, gravity, faults, joints."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from os.path import commonprefix
from pathlib import Path
from typing import NamedTuple

from rich.console import RenderableType
from rich.text import Text

from ....errors import shorten
from ....recording.columns import UNSTATED
from ....types import Recording, StatedUnit
from ..documents import Document
from ..layout import heading, new_table, paragraph, plural
from ..sections import Cells

GOOD, LIMITED, FAULTY, UNUSABLE = "good", "limited", "faulty", "unusable"
CUT = 24  # length of the name of a recording that is never cut [characters]
BRACKETED_DETAIL = re.compile(r" \([^()]*\)$")  # a detail in brackets at the end of a part of a sentence
MAX_RECORDINGS, MAX_ALIKE_SENTENCES, MAX_PARAMETER_NAMES = 8, 3, 16  # on the screen
CHECK_STYLES = {"good": "green", "limited": "yellow", "faulty": "red", "unusable": "red"}
NUMBER_IN_TEXT = re.compile(r"[\d.]+")
FURTHER_PLACE = "in --json and in the report (-o DIR)"
MAX_NAMED_JOINTS = 6  # most joints that a sentence names
WORDS = {"t": "time", "q": "position", "q_des": "command", "dq": "velocity", "ddq": "acceleration", "tau": "torque"}
RATE_SUFFIX = {"dq": "/s", "ddq": "/s2", "dq_des": "/s"}  # what follows the unit of position
SAMPLING_HEADS = "recording", "rows>", "used>", "seconds>", "rate\n[Hz]>", "content\n[Hz]>", "clock", "breaks>"
UNSTATED_UNIT = StatedUnit("", "")
OTHER_UNITS = {"t": "s", "on": "1", "pwm": "1", "volt": "V", "temp": "C"}  # units of other signals


class UnitUse(NamedTuple):
    """Columns of one signal, and how their values become those of a recording."""

    signal: str  # "q"
    columns: tuple[str, ...]
    unit: str  # as stated: "deg"; "" if nothing states one
    by: str  # what states it: "the column map"; "" if nothing does
    into: str  # "rad"; "" if the unit stays unknown
    factors: tuple[float, ...] = ()  # torque per unit: least and largest torque constant of currents


class GravityUse(NamedTuple):
    """Gravity as the recordings show it."""

    verdict: str  # "agrees", "differs", "uncertain" or "not judged"
    sentence: str


class FaultWords(NamedTuple):
    """A fault of a log."""

    kind: str  # "torque sign"; "" where faults have no kinds
    joints: tuple[str, ...]
    sentence: str  # fact, evidence and advice

    @property
    def fact(self) -> str:
        """The fact alone."""
        return first_part(self.sentence)

    @property
    def worst(self) -> str:
        """The fact with a number: its own, or that of the evidence."""
        evidence = self.sentence.removeprefix(self.fact).removeprefix("; ").partition("; ")[0]
        fact, evidence = (BRACKETED_DETAIL.sub("", text) for text in (self.fact, evidence))
        return fact if any(x.isdigit() for x in fact) or not evidence else f"{fact}: {evidence}"


class Identifiable(NamedTuple):
    """Names of what can be identified, by verdict."""

    noun: str  # "base parameter"
    identifiable: tuple[str, ...]
    weak: tuple[str, ...]
    unidentifiable: tuple[str, ...]

    @property
    def total(self) -> int:
        """Number of all names."""
        return len(self.identifiable) + len(self.weak) + len(self.unidentifiable)

    @property
    def counts(self) -> str:
        """Counts in a sentence."""
        counts = f"{len(self.identifiable)} identifiable, {len(self.weak)} weak"
        return f"{plural(self.total, self.noun)}: {counts}, {len(self.unidentifiable)} unidentifiable"


@dataclass(frozen=True, kw_only=True)
class CheckSummary:
    """All that is said about recordings before a fit, in the order of the screen."""

    title: str
    verdict: str  # GOOD, LIMITED, FAULTY or UNUSABLE
    headline: str
    sampling: Cells
    sampled: tuple[str, ...] = ()  # sentences on clock, gaps and content
    units: tuple[UnitUse, ...] = ()
    unit_notes: tuple[str, ...] = ()  # units that may be wrong
    gravity: GravityUse
    faults: tuple[FaultWords, ...]
    clear: tuple[str, ...] = ()  # faults that were looked for and not found
    joints: Cells = Cells((), ())
    legend: str = ""  # of the table of joints
    identifiable: Identifiable
    excitation: str = ""  # sentence on it; "" where it was not judged
    advice: tuple[str, ...]
    notes: tuple[str, ...] = ()


def identifiable_of(noun: str, names: Sequence[str], verdicts: Iterable[str]) -> Identifiable:
    """Names by their verdicts."""
    groups: dict[str, list[str]] = {"identifiable": [], "weak": [], "unidentifiable": []}
    for name, verdict in zip(names, verdicts, strict=True):
        groups[verdict].append(name)
    return Identifiable(noun, *map(tuple, groups.values()))


def first_part(sentence: str) -> str:
    """The fact of a sentence, without evidence and advice."""
    return sentence.partition("; ")[0]


def recording_names(recordings: Sequence[Recording]) -> list[str]:
    """Names of recordings for a table: without folder and suffix where these are not needed."""
    paths = [Path(recording.path) for recording in recordings]
    plain = [path.name.partition(".")[0] or path.name or "(arrays)" for path in paths]
    short = plain if len(set(plain)) == len(plain) else [str(path) for path in paths]
    same = len(commonprefix(short)) if max(map(len, short)) > CUT else 0
    same = same if min(map(len, short)) > same else 0
    return [f"…{name[same:]}"[-CUT:] if same else name if len(name) <= CUT else f"…{name[1 - CUT :]}" for name in short]


def joint_words(joints: Sequence[str], total: int) -> str:
    """Some joints of all in a sentence."""
    return "all joints" if len(joints) == total > 1 else shorten(joints, MAX_NAMED_JOINTS)


def unit_uses(recordings: Sequence[Recording], positions: Mapping[str, str]) -> tuple[UnitUse, ...]:
    """Units of all signals; positions: unit of each joint's position, "" if it is unknown."""
    uses: dict[tuple[str, StatedUnit, str, bool], dict[str, float]] = {}
    for recording in recordings:
        for signal, group in recording.columns.items():
            for j, column in enumerate(group):
                if column:
                    place = "" if signal in OTHER_UNITS else positions.get(recording.joints[j], "rad")
                    if signal in OTHER_UNITS:
                        into = OTHER_UNITS[signal]
                    elif signal in ("tau", "tau_ff"):
                        into = "N" if place == "m" else "N.m"
                    else:
                        into = place and place + RATE_SUFFIX.get(signal, "")
                    if signal == "tau" and recording.scaled is not None and not recording.scaled[j]:
                        into = "A"  # a current without a torque constant
                    factor = float(recording.torque_per_unit[j]) if signal == "tau" else 1.0
                    key = signal, recording.units.get(column, UNSTATED_UNIT), into, factor != 1
                    uses.setdefault(key, {})[column] = factor
    ordered = sorted(uses.items(), key=lambda item: [*WORDS, item[0][0]].index(item[0][0]))
    return tuple(
        UnitUse(signal, tuple(scales), *stated, into, (min(scales.values()), max(scales.values())) if current else ())
        for (signal, stated, into, current), scales in ordered
    )


def unit_sentences(uses: Sequence[UnitUse]) -> Iterator[str]:
    """One sentence for each source of units: what they are converted to, that they are assumed, or unknown."""
    groups: dict[str, dict[str, list[str]]] = {}
    for use in uses:
        source = f"stated by {use.by}" if use.by else "not stated, assumed" if use.into else "unit unknown"
        if use.columns == ("t",):
            columns_text = "t"
        elif len(use.columns) > 1 and all(column.startswith(f"{use.signal}_") for column in use.columns):
            columns_text = f"{use.signal}_J"
        else:
            word = WORDS.get(use.signal, "") + (" from" if use.factors else "")
            columns_text = f"{word} {shorten(use.columns, 2)}".lstrip()
        if use.factors:
            low, high = (f"{x:.3g}" for x in use.factors)
            constants = f"constant{'' if low == high else 's'} {low if low == high else f'{low} to {high}'}"
            conversion = f"in {use.unit or 'A'}, times torque {constants} {use.into}/A"
        elif not use.by:
            conversion = {"": "", "1": "without unit"}.get(use.into, f"in {use.into}")
        elif "value" in use.unit:
            conversion = f"as {use.unit}, in {use.into}"
        else:
            conversion = f"in {use.unit}" if use.unit == use.into else f"in {use.unit} (converted to {use.into})"
        groups.setdefault(source, {}).setdefault(conversion, []).append(columns_text)
    for source, parts in groups.items():
        said = "; ".join(f"{', '.join(columns)} {how}".rstrip() for how, columns in parts.items())
        yield f"{source}: {said}"


def unit_notes(notes: Sequence[str]) -> tuple[str, ...]:
    """Notes on units that may be wrong."""
    return tuple(dict.fromkeys(note for note in notes if UNSTATED in note))


def summary_document(summary: CheckSummary) -> Document:
    """Entries that a check has in both modes."""
    which = summary.identifiable
    return {
        "verdict": summary.verdict,
        "headline": summary.headline,
        "units": [
            {"signal": use.signal, "columns": list(use.columns), "stated": use.unit or None, "by": use.by or None}
            | {"unit": use.into or None, "torque_constants": list(use.factors) or None}
            for use in summary.units
        ],
        "gravity": summary.gravity._asdict(),
        "faults": [
            {"kind": fault.kind or None, "joints": list(fault.joints), "sentence": fault.sentence}
            for fault in summary.faults
        ],
        "looked_for": list(summary.clear),
        "identifiable": {
            "of": which.total,
            **{key: list(getattr(which, key)) for key in ("identifiable", "weak", "unidentifiable")},
        },
    }


def summary_tables(summary: CheckSummary) -> list[RenderableType]:
    """The description in the order of the screen; further lines are counted."""
    which = summary.identifiable
    sampling: list[RenderableType] = []
    rows = summary.sampling.rows
    sampling.append(_table(Cells(summary.sampling.heads, rows[:MAX_RECORDINGS])))
    if len(rows) > MAX_RECORDINGS:
        sampling.append(paragraph(f"and {plural(len(rows) - MAX_RECORDINGS, 'more recording')} {FURTHER_PLACE}"))
    alike: dict[str, list[str]] = {}
    for said in summary.sampled:
        alike.setdefault(NUMBER_IN_TEXT.sub("", said), []).append(said)
    sampling += _labelled(
        "sampling", [f"{first} ({len(more)} more alike)" if more else first for first, *more in alike.values()]
    )
    return [
        heading(summary.title, below=False),
        Text(summary.headline, CHECK_STYLES[summary.verdict]),
        paragraph(""),
        *sampling,
        *_labelled("units", [*unit_sentences(summary.units), *summary.unit_notes]),
        *_labelled("gravity", [summary.gravity.sentence]),
        *_labelled("faults", [fault.fact for fault in summary.faults if fault.kind != "gravity"]),
        *([paragraph(f"faults: none of: {', '.join(summary.clear)}")] if summary.clear else []),
        *([paragraph(""), _table(summary.joints), paragraph(f"{summary.legend}.")] if summary.joints.rows else []),
        heading(which.counts),
        *_labelled("weak", [_leading(which.weak)] if which.weak else []),
        *_labelled("unidentifiable", [_leading(which.unidentifiable)] if which.unidentifiable else []),
        *([paragraph(summary.excitation)] if summary.excitation else []),
        *_labelled("advice", summary.advice),
        *_labelled("note", summary.notes),
    ]


def _table(grid: Cells) -> RenderableType:
    return new_table(*grid.heads, rows=grid.rows)


def _labelled(label: str, sentences: Sequence[str]) -> Iterator[RenderableType]:
    """A line for each of the first sentences, with a label, and the number of the others."""
    for sentence in sentences[:MAX_ALIKE_SENTENCES]:
        yield paragraph(f"{label}: {sentence}")
    if len(sentences) > MAX_ALIKE_SENTENCES:
        yield paragraph(f"{label}: and {len(sentences) - MAX_ALIKE_SENTENCES} more {FURTHER_PLACE}")


def _leading(names: Sequence[str]) -> str:
    """First terms of the formulas of parameters."""
    short = [name if " " not in name else f"{name.partition(' ')[0]}…" for name in names]
    return shorten(short, MAX_PARAMETER_NAMES)
