"""Description of a check -> terminal text of one screen."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from rich.console import RenderableType
from rich.text import Text

from .....errors import shorten
from ...layout import heading, new_table, paragraph, plural
from ...sections import Cells
from .drives import audit_summary
from .summary import CheckSummary, unit_sentences
from .torque import check_summary

if TYPE_CHECKING:
    from .....check import Check
    from .....faults import ServoAudit

RECORDINGS, SENTENCES, NAMES = 8, 3, 16  # most recordings, sentences of one kind and names of parameters on the screen
STYLES = {"good": "green", "limited": "yellow", "faulty": "red", "unusable": "red"}
NUMBER = re.compile(r"[\d.]+")
MORE = "in --json and in the report (-o DIR)"


def check_tables(found: Check) -> list[RenderableType]:
    """Sampling, units, gravity, faults, joints and what is identifiable, on one screen."""
    return summary_tables(check_summary(found))


def audit_tables(found: ServoAudit, robot: str = "") -> list[RenderableType]:
    """The same of an audit of position drives; `robot`: its name, "" without a description."""
    return summary_tables(audit_summary(found, robot))


def summary_tables(summary: CheckSummary) -> list[RenderableType]:
    """The description in the order of the screen; further lines are counted."""
    which = summary.identifiable
    return [
        heading(summary.title, below=False),
        Text(summary.headline, STYLES[summary.verdict]),
        paragraph(""),
        *_sampling(summary),
        *_labelled("units", [*unit_sentences(summary.units), *summary.unit_notes]),
        *_labelled("gravity", [summary.gravity.sentence]),
        *(paragraph(f"faults: {line}") for line in _fault_lines(summary)),
        *([paragraph(""), _table(summary.joints), paragraph(f"{summary.legend}.")] if summary.joints.rows else []),
        heading(which.counts),
        *_labelled("weak", [_leading(which.weak)] if which.weak else []),
        *_labelled("unidentifiable", [_leading(which.unidentifiable)] if which.unidentifiable else []),
        *([paragraph(summary.excitation)] if summary.excitation else []),
        *_labelled("advice", summary.advice),
        *_labelled("note", summary.notes),
    ]


def _fault_lines(summary: CheckSummary) -> Iterator[str]:
    """Each fault but gravity, which has a line of its own, and what was looked for without success."""
    found = [fault.fact for fault in summary.faults if fault.kind != "gravity"]
    yield from found[:SENTENCES]
    if len(found) > SENTENCES:
        yield f"and {len(found) - SENTENCES} more {MORE}"
    if summary.clear:
        yield f"none of: {', '.join(summary.clear)}"


def _sampling(summary: CheckSummary) -> Iterator[RenderableType]:
    rows = summary.sampling.rows
    yield _table(Cells(summary.sampling.heads, rows[:RECORDINGS]))
    if len(rows) > RECORDINGS:
        yield paragraph(f"and {plural(len(rows) - RECORDINGS, 'more recording')} {MORE}")
    alike: dict[str, list[str]] = {}
    for said in summary.sampled:
        alike.setdefault(NUMBER.sub("", said), []).append(said)
    yield from _labelled(
        "sampling", [f"{one} ({len(more)} more alike)" if more else one for one, *more in alike.values()]
    )


def _table(grid: Cells) -> RenderableType:
    return new_table(*grid.heads, rows=grid.rows)


def _labelled(label: str, sentences: Sequence[str]) -> Iterator[RenderableType]:
    """A line for each of the first sentences, with a label, and the number of the others."""
    for sentence in sentences[:SENTENCES]:
        yield paragraph(f"{label}: {sentence}")
    if len(sentences) > SENTENCES:
        yield paragraph(f"{label}: and {len(sentences) - SENTENCES} more {MORE}")


def _leading(names: Sequence[str]) -> str:
    """First terms of the formulas of parameters."""
    short = [name if " " not in name else f"{name.partition(' ')[0]}…" for name in names]
    return shorten(short, NAMES)
