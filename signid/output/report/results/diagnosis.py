"""Diagnosis: JSON document and terminal tables of verdict, findings, alternatives and validation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

from rich.console import RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ....effects.naming import law_place
from ....types import Array, Input, Robot
from ..documents import Document, description, fit_with_errors, opening, picked, provenance
from ..layout import determination, figure, heading, new_table, note_lines, paragraph, plural
from . import sentences as words
from .laws import changed_link, finding_numbers, law_words
from .signs import signs_document, signs_tables

if TYPE_CHECKING:
    from ....diagnose import Diagnosis, Finding

INFORMED = "The covariance of the simulation is used as prior for its inertials and laws"
FURTHER = "their errors appear about {:g} times larger, which makes alternatives harder to distinguish"
RED = "bold red"  # of a headline whose flags say that it is not reliable
COLOURS = {"nothing_missing": "bold green", "named": "bold", "unknown": "bold yellow"}
CAUSES, CORRECTIONS, PLACES = 6, 3, 8  # maximum number shown


def diagnosis_document(result: Diagnosis, inputs: Sequence[Input] = ()) -> Document:
    """Build the content of diagnosis.json; `inputs` besides the recordings default to the robot description."""
    robot, before, after = result.robot, result.rollout_before, result.rollout_after
    return {
        **opening("signid.diagnosis/1", robot),
        "verdict": result.verdict,
        **({"question": result.question} if result.question else {}),
        "tolerance": result.tolerance,
        "findings": [_finding(robot, finding) for finding in result.findings],
        "unexplained": [
            {
                "joint": robot.joints[left.joint],
                "depends_on": left.place.variable,
                "share": left.share,
                "region": left.place.region,
                "held_out_gain": left.held_out_gain,
                "empirical": left.modelled,
                "without_cause": left in result.without_cause,
            }
            for left in result.unexplained
        ],
        "located": [
            {"joint": robot.joints[x.joint], "depends_on": x.variable, **picked(x, "region share explained")}
            for x in result.located
        ],
        "fit": {"before": fit_with_errors(result.before), "after": fit_with_errors(result.after)},
        "rollout": None if before is None or after is None else after.document(before),
        "inertials": {"off": None if result.informed else result.prior_scale, "covariance": result.informed},
        "signs": signs_document(result.signs),
        "cutoff": {"torque": result.cutoff, "unit": "Hz"},
        "flags": list(result.flags),
        "notes": diagnosis_notes(result),
        **provenance(result.inputs, inputs or [description(robot)], result.seed),
    }


def diagnosis_notes(result: Diagnosis) -> list[str]:
    """Notes of a diagnosis, including one on the use of the simulation's covariance."""
    if not result.informed:
        return list(result.notes)
    return [*result.notes, f"{INFORMED}, {FURTHER.format(result.prior_scale)}" if result.prior_scale > 1 else INFORMED]


def _finding(robot: Robot, finding: Finding) -> Document:
    where, shares = finding.where, zip(robot.joints, finding.torque_share.tolist(), strict=True)
    return {
        "effect": finding.law.effect.name,
        "joint": law_place(finding.law, robot)[0],
        "link": changed_link(robot, finding.law),
        **picked(finding, "role in_model probability"),
        "parameters": finding_numbers(robot, finding),
        "meaning": finding.law.effect.meaning(finding.law.parameters),
        "torque_share": {name: share for name, share in shares if share > 0},
        "where": {
            "joint": robot.joints[where.joint],
            **picked(where, "variable region share"),
            **({"time_origin": where.origin} if where.origin else {}),
        },
        "evidence": picked(finding, "statistic threshold held_out_gain"),
        "alternatives": [
            {"effect": rival.law.effect.name, "joint": law_place(rival.law, robot)[0]}
            | picked(rival, "probability separating_motion")
            for rival in finding.alternatives
        ],
    }


def diagnosis_tables(result: Diagnosis) -> list[RenderableType]:
    """Verdict, location of the residual, findings, alternatives, unexplained residual and held-out validation."""
    left, unreliable = words.unexplained_words(result), words.is_unreliable(result.flags)
    return [
        Text(f"{result.robot.name}: {words.verdict_words(result)}", RED if unreliable else COLOURS[result.verdict]),
        heading("Residual of the simulation"),
        *map(paragraph, words.place_words(result, PLACES)),
        *_findings(result),
        *map(paragraph, words.trust_words(result)),
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
    robot, titles = result.robot, words.role_words(result)
    small = [finding for finding in result.findings if finding.role == "secondary"]
    if result.causes:
        yield heading(titles["cause"])
        yield from _causes([words.finding_words(robot, finding) for finding in result.causes[:CAUSES]])
        yield from _more(len(result.causes) - CAUSES)
    if small:
        yield heading(titles["secondary"])
        lines = (words.secondary_words(robot, finding) for finding in small[:CORRECTIONS])
        yield from (Text(line, no_wrap=True, overflow="ellipsis") for line in lines)
        yield from _more(len(small) - CORRECTIONS)


def _causes(causes: Sequence[words.FindingWords]) -> Iterator[RenderableType]:
    """A row per cause, with its parameters below."""
    heads = ("law and its parameters, ± 95 %", "probability>", "of torque", "mostly")
    rows = [(cells.law, cells.probability, cells.torque, cells.where) for cells in causes]
    width = [max(map(len, [head.removesuffix(">"), *cells])) for head, *cells in zip(heads, *rows, strict=True)]
    for k, cells in enumerate(causes):
        table = new_table(*heads, rows=[rows[k]])
        table.show_header = k == 0
        for column, wide in zip(table.columns[:3], width, strict=False):
            column.no_wrap, column.min_width = True, wide
        yield table
        yield from map(_indented, cells.numbers)


def _indented(line: str) -> RenderableType:
    return Padding(paragraph(line), (0, 0, 0, 2), expand=False)


def _more(number: int) -> list[RenderableType]:
    return [paragraph(f"and {plural(number, 'smaller finding')} in diagnosis.json")] if number > 0 else []


def _alternatives(result: Diagnosis) -> Iterator[RenderableType]:
    rivals = [(finding, words.alternative_words(result.robot, finding)) for finding in result.causes[:CAUSES]]
    if any(cells for _, cells in rivals):
        yield heading("Alternatives that explain the recordings equally well, or nearly")
    for finding, cells in rivals:
        if cells:
            yield paragraph(law_words(result.robot, finding.law))
            yield from map(_indented, cells)


def _fit(result: Diagnosis) -> Table:
    table = new_table("joint", "before>", "after>", "irreducible>", "unit", "R2 before>", "R2 after>")
    before, after = result.before, result.after
    for j, joint in enumerate(before.joints):
        rms = change(float(before.held_out_rms[j]), float(after.held_out_rms[j]))
        r2 = (determination(float(fit.held_out_r2[j])) for fit in (before, after))
        table.add_row(joint, *rms, figure(float(before.irreducible_rms[j]), 2), before.unit[j], *r2)
    return table


def _rolled(result: Diagnosis) -> Iterator[RenderableType]:
    if errors := rollout_errors(result):
        yield heading(f"Roll-outs of {errors.horizon:g} s from measured states: rms position error at the end")
        columns = (errors.joints, errors.unit, errors.before.tolist(), errors.after.tolist())
        rows = ((joint, *change(*rms), unit) for joint, unit, *rms in zip(*columns, strict=True))
        yield new_table("joint", "before>", "after>", "unit", rows=rows)


class RollOutErrors(NamedTuple):
    """Rms position errors at the end of the longest roll-outs."""

    horizon: float  # [s]
    joints: tuple[str, ...]
    unit: tuple[str, ...]
    before: Array  # (n,) [rad or m]
    after: Array  # (n,) [rad or m]


def rollout_errors(result: Diagnosis) -> RollOutErrors | None:
    """Errors of the original and the extended simulation, if there are roll-outs."""
    before, after = result.rollout_before, result.rollout_after
    if before is None or after is None:
        return None
    horizon = max(before.horizons)
    return RollOutErrors(horizon, before.joints, before.unit, before.rms(horizon), after.rms(horizon))


def change(before: float, after: float) -> tuple[Text, Text]:
    """An error before and after the extension; after in red if clearly larger."""
    return Text(figure(before)), Text(figure(after), "red" if after > words.WORSE * before else "")
