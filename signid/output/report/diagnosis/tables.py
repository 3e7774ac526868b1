"""Terminal tables of a diagnosis: verdict, findings, alternatives and validation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ....diagnose import Diagnosis
from ..layout import heading, new_table, note_lines, paragraph, plural
from ..numbers import determination, figure
from ..results.signs import signs_tables
from .document import diagnosis_notes
from .numbers import law_words
from .words import (
    WORSE,
    FindingWords,
    alternative_words,
    finding_words,
    place_words,
    role_words,
    secondary_words,
    trust_words,
    unexplained_words,
    verdict_words,
)

COLOURS = {"nothing_missing": "bold green", "named": "bold", "unknown": "bold yellow"}
CAUSES, CORRECTIONS = 6, 3  # maximum number shown


def diagnosis_tables(result: Diagnosis) -> list[RenderableType]:
    """Verdict, location of the residual, findings, alternatives, unexplained residual and held-out validation."""
    left = unexplained_words(result)
    return [
        Text(f"{result.robot.name}: {verdict_words(result)}", COLOURS[result.verdict]),
        heading("Residual of the simulation"),
        *map(paragraph, place_words(result)),
        *_findings(result),
        *map(paragraph, trust_words(result)),
        *_alternatives(result),
        *([heading("Unexplained residual"), *map(paragraph, left)] if left else []),
        *([] if result.signs is None else signs_tables(result.signs)),
        heading("Held-out data: rms of the residual torque"),
        _fit(result),
        *_rolled(result),
        *note_lines(diagnosis_notes(result)),
    ]


def _findings(result: Diagnosis) -> Iterator[RenderableType]:
    """The largest causes with their parameters, the largest corrections, and the number of others."""
    robot, titles = result.robot, role_words(result)
    small = [finding for finding in result.findings if finding.role == "secondary"]
    if result.causes:
        yield heading(titles["cause"])
        yield from _causes([finding_words(robot, finding) for finding in result.causes[:CAUSES]])
        yield from _more(len(result.causes) - CAUSES, "smaller finding")
    if small:
        yield heading(titles["secondary"])
        lines = (secondary_words(robot, finding) for finding in small[:CORRECTIONS])
        yield from (Text(line, no_wrap=True, overflow="ellipsis") for line in lines)
        yield from _more(len(small) - CORRECTIONS, "smaller finding")


def _causes(causes: Sequence[FindingWords]) -> Iterator[RenderableType]:
    """A row per cause, with its parameters below."""
    heads = ("law and its parameters, ± 95 %", "probability>", "of torque", "mostly")
    rows = [(words.law, words.probability, words.torque, words.where) for words in causes]
    width = [max(map(len, [head.removesuffix(">"), *cells])) for head, *cells in zip(heads, *rows, strict=True)]
    for k, words in enumerate(causes):
        table = new_table(*heads)
        table.show_header = k == 0
        for column, wide in zip(table.columns[:3], width, strict=False):
            column.no_wrap, column.min_width = True, wide
        table.add_row(*rows[k])
        yield table
        yield from map(_indented, words.numbers)


def _indented(line: str) -> RenderableType:
    return Padding(paragraph(line), (0, 0, 0, 2), expand=False)


def _more(number: int, noun: str) -> list[RenderableType]:
    return [paragraph(f"and {plural(number, noun)} in diagnosis.json")] if number > 0 else []


def _alternatives(result: Diagnosis) -> Iterator[RenderableType]:
    rivals = [(finding, alternative_words(result.robot, finding)) for finding in result.causes[:CAUSES]]
    if any(words for _, words in rivals):
        yield heading("Alternatives that explain the recordings equally well, or nearly")
    for finding, words in rivals:
        if words:
            yield paragraph(law_words(result.robot, finding.law))
            yield from map(_indented, words)


def _fit(result: Diagnosis) -> Table:
    table = new_table("joint", "before>", "after>", "irreducible>", "unit", "R2 before>", "R2 after>")
    before, after = result.before, result.after
    for j, joint in enumerate(before.joints):
        rms = change(float(before.held_out_rms[j]), float(after.held_out_rms[j]))
        r2 = (determination(float(fit.held_out_r2[j])) for fit in (before, after))
        table.add_row(joint, *rms, figure(float(before.irreducible_rms[j]), 2), before.unit[j], *r2)
    return table


def _rolled(result: Diagnosis) -> Iterator[RenderableType]:
    before, after = result.rollout_before, result.rollout_after
    if before is None or after is None:
        return
    horizon = max(before.horizons)
    table = new_table("joint", "before>", "after>", "unit")
    for joint, unit, *rms in zip(before.joints, before.unit, before.rms(horizon), after.rms(horizon), strict=True):
        table.add_row(joint, *change(*map(float, rms)), unit)
    yield heading(f"Roll-outs of {horizon:g} s from measured states: rms position error at the end")
    yield table


def change(before: float, after: float) -> tuple[Text, Text]:
    """An error before and after the extension; after in red if clearly larger."""
    return Text(figure(before)), Text(figure(after), "red" if after > WORSE * before else "")
