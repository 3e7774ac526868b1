"""Diagnosis: JSON document, terminal tables and page of verdict, findings, alternatives and validation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from inspect import getdoc
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from rich.console import RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ....effects.naming import law_place
from ....types import Array, Input, Robot
from ..documents import Document, description, fit_with_errors, opening, picked, provenance
from ..layout import confidence, determination, figure, heading, new_table, note_lines, paragraph, plural
from ..plots.courses import joint_plots, rollout_plots, worst
from ..plots.frame import AFTER, BEFORE, render, shared
from ..plots.heat import heat_maps, hottest
from ..sections import Card, Plot
from . import sentences as words
from .laws import changed_link, finding_numbers, law_words, number_cells
from .sentences import finding_headline, named, sentence_case, subject
from .signs import signs_document, signs_tables

if TYPE_CHECKING:
    from ....diagnose import Diagnosis, Finding

INFORMED = "The covariance of the simulation is used as prior for its inertials and laws"
FURTHER = "their errors appear about {:g} times larger, which makes alternatives harder to distinguish"
RED = "bold red"  # of a headline whose flags say that it is not reliable
COLOURS = {"nothing_missing": "bold green", "named": "bold", "unknown": "bold yellow"}
CAUSES, CORRECTIONS, PLACES = 6, 3, 8  # maximum number shown
SURE = 0.95  # probability from which a finding is considered certain
LOUD = 1.5  # ratio of residual to irreducible rms from which a joint is unfolded
LISTED = 5  # maximum number of alternatives drawn


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


def diagnosis_page(result: Diagnosis, inputs: Sequence[Input] = (), command: str = "") -> str:
    """Render report.html of a diagnosis; `inputs` besides the recordings default to the description."""
    floor, order = result.before.irreducible_rms, worst(result.before)
    chosen = [j for j in order if result.before.held_out_rms[j] > LOUD * floor[j]]
    heat_before, heat_after, top = residual_maps(result)
    first, last = result.rollout_before, result.rollout_after
    rolled = first and last and rollout_plots([("before", first, BEFORE, "dot"), ("after", last, AFTER, "solid")])
    return render(
        "diagnosis.html",
        title=f"{result.robot.name}: {words.verdict_words(result)}",
        unreliable=words.is_unreliable(result.flags),
        cards=[card for card in _cards(result, order[0]) if "-" not in card.figure.split()],
        places=words.place_words(result, PLACES),
        every_place=words.place_words(result) if len(result.located) > PLACES else [],
        heat_before=heat_before,
        heat_after=heat_after if result.findings else [],
        heat_top=figure(top, 2),
        roles=[(title, list(_laws(result, role))) for role, title in words.role_words(result).items()],
        sure=SURE,
        trust=words.trust_words(result),
        rivals=list(_rivals_shown(result)),
        left=words.unexplained_words(result),
        worse=words.WORSE,
        joints=joint_plots(result.held_out, result.before, result.after, chosen or order[:1]),
        rolled=rolled,
        errors=rollout_errors(result),
        **shared(result, [result.robot], inputs, command) | {"notes": diagnosis_notes(result)},
    )


def residual_maps(result: Diagnosis) -> tuple[list[Plot], list[Plot], float]:
    """Heat maps of the residual before and after the extension, and the largest ratio of their colours [1]."""
    learned, floor = result.train, result.before.irreducible_rms
    before, after = (left / floor for left in (learned.before, learned.after))
    top = hottest(learned, before)
    return heat_maps(learned, before, top), heat_maps(learned, after, top), top


def _cards(result: Diagnosis, j: int) -> Iterator[Card]:
    """Key figures: residual and R2 of the worst joint, and the most improved roll-out."""
    before, after, joint = result.before, result.after, result.before.joints[j]
    rms = " → ".join(figure(float(fit.held_out_rms[j])) for fit in (before, after))
    floor = f"irreducible {figure(float(before.irreducible_rms[j]), 2)} {before.unit[j]}"
    yield Card(f"residual torque of {joint}, held out", f"{rms} {before.unit[j]}", floor)
    r2 = " → ".join(determination(float(fit.held_out_r2[j])) for fit in (before, after))
    yield Card("R2 of this torque, held out", r2, "1 is perfect")
    if errors := rollout_errors(result):
        k = int(np.argmax(np.nan_to_num(errors.before / np.maximum(errors.after, 1e-300))))
        change = " → ".join(figure(float(rms[k])) for rms in (errors.before, errors.after))
        title = f"{errors.horizon:g} s roll-outs: position error of {errors.joints[k]}"
        yield Card(title, f"{change} {errors.unit[k]}", "rms")


def _laws(result: Diagnosis, role: str) -> Iterator[dict[str, Any]]:
    """Yield the content of each finding of a role."""
    for finding in (finding for finding in result.findings if finding.role == role):
        cells, title = words.finding_words(result.robot, finding), _title(result, finding)
        yield {
            "finding": finding,
            "effect": finding.law.effect,
            "words": cells,
            "title": title,
            "summary": " ".join((getdoc(type(finding.law.effect)) or "").split()),
            "numbers": number_cells(result.robot, finding),
            "rivals": _rivals(result, finding),
            "row": (title, "; ".join(cells.numbers), *cells[2:]),
        }


def _title(result: Diagnosis, finding: Finding) -> str:
    """A finding in words, with its main number."""
    return sentence_case(finding_headline(named(result.robot, finding.law, finding.std, finding.stated)))


def _rivals_shown(result: Diagnosis) -> Iterator[tuple[str, list[str], list[str]]]:
    """Yield each finding with its most probable alternatives, and the others, which are folded."""
    for finding in result.findings:
        if shown := words.alternative_words(result.robot, finding):
            whole = words.alternative_words(result.robot, finding, None)
            first = [line for line in shown if line in whole]
            law = subject(named(result.robot, finding.law, finding.std))
            yield sentence_case(law), first, [line for line in whole if line not in first]


def _rivals(result: Diagnosis, finding: Finding) -> list[tuple[str, float, str]]:
    """A finding and its most probable alternatives: name, probability [%], formatted probability."""
    rivals = [(rival.law, rival.probability) for rival in finding.alternatives if rival.probability >= words.NEGLIGIBLE]
    first = [(finding.law, finding.probability), *sorted(rivals, key=lambda pair: -pair[1])[:LISTED]]
    return [(law_words(result.robot, law), 100 * p, confidence(p)) for law, p in first]
