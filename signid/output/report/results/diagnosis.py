"""Diagnosis: JSON document, terminal tables and page of verdict, findings, alternatives and validation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from inspect import getdoc
from typing import TYPE_CHECKING

import numpy as np
from rich.console import RenderableType
from rich.padding import Padding
from rich.text import Text

from ....effects.naming import law_place
from ....types import Input
from ..documents import Document, description, fit_with_errors, opening, picked, provenance
from ..layout import Worse, confidence, determination, figure, heading, log_odds, paragraph, plural, share
from ..pages import BLUE, ORANGE, Header, sections_page, shared
from ..plots import heat_maps, hottest, joint_plots, rollout_plots, worst
from ..quantities import changed_link, finding_numbers, law_words, number_cells, parameters
from ..sections import (
    Bar,
    Card,
    Cells,
    Fold,
    Folds,
    Key,
    LawCard,
    Laws,
    Legend,
    Plain,
    Plots,
    Section,
    Sentences,
    terminal,
)
from . import sentences as words
from .sentences import finding_headline, named, sentence_case, subject
from .signs import signs_document, signs_sections

if TYPE_CHECKING:
    from ....diagnose import Diagnosis, Finding

INFORMED = "The covariance of the simulation is used as prior for its inertials and laws"
INFLATED = "their errors appear about {:g} times larger, which makes alternatives harder to distinguish"
RED = "bold red"  # of a headline whose flags say that it is not reliable
STYLES = {"nothing_missing": "bold green", "named": "bold", "unknown": "bold yellow", "undecided": "bold yellow"}
MAX_CAUSES, MAX_CORRECTIONS, MAX_PLACES = 6, 3, 8  # maximum number shown
MIN_CERTAIN_PROBABILITY = 0.95  # probability from which a finding is considered certain
UNFOLDED_RESIDUAL_RATIO = 1.5  # ratio of residual to irreducible rms from which a joint is unfolded
MAX_DRAWN = 5  # maximum number of alternatives drawn
RESIDUAL = "Residual of the simulation"
ORDINARY = "Ordinary: the description does not state it"
KEY = (("measured", "measured"), ("before", "before"), ("after", "after: extended simulation"))
CORRECTION_HEADS = ("law", "parameters, ± 95 %", "probability>", "of torque>", "mostly")
HEAT_LEGEND = (
    "rms residual over what no model could predict, on training data; load: predicted torque of the original "
    "simulation; blank: noise, or too few rows"
)


def diagnosis_document(result: Diagnosis, inputs: Sequence[Input] = ()) -> Document:
    """Build the content of diagnosis.json; `inputs` besides the recordings default to the robot description."""
    robot, before, after = result.robot, result.rollout_before, result.rollout_after
    return {
        **opening("signid.diagnosis/1", robot),
        "verdict": result.verdict,
        **({"question": result.question} if result.question else {}),
        "tolerance": result.tolerance,
        "findings": [_finding(result, finding) for finding in result.findings],
        "ordinary": list(_ordinary(result)),
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
        "detectable": [law._asdict() for law in result.detectable],
        "fit": {"before": fit_with_errors(result.before), "after": fit_with_errors(result.after)},
        "rollout": None if before is None or after is None else after.document(before),
        "inertials": {"off": None if result.informed else result.prior_scale, "covariance": result.informed},
        "signs": None if result.signs is None else signs_document(result.signs),
        "cutoff": {"torque": result.cutoff, "unit": "Hz"},
        "flags": list(result.flags),
        "notes": diagnosis_notes(result),
        **provenance(result.inputs, inputs or [description(robot)], result.seed),
    }


def diagnosis_notes(result: Diagnosis) -> list[str]:
    """Notes of a diagnosis, including one on the use of the simulation's covariance."""
    if not result.informed:
        return list(result.notes)
    return [*result.notes, f"{INFORMED}, {INFLATED.format(result.prior_scale)}" if result.prior_scale > 1 else INFORMED]


def _finding(result: Diagnosis, finding: Finding) -> Document:
    robot, where = result.robot, finding.where
    shares = zip(robot.joints, finding.torque_share.tolist(), strict=True)
    left = next((x for x in result.unexplained if x.joint == where.joint and not finding.ordinary), None)
    rest = 0.0 if left is None else left.share * max(left.place.explained, 0.0) ** 0.5
    moved = float(np.sqrt(np.nanmean(result.train.torque[:, where.joint] ** 2)))
    return {
        "effect": finding.law.effect.name,
        "joint": law_place(finding.law, robot)[0],
        "link": changed_link(robot, finding.law),
        **picked(finding, "role in_model probability"),
        **({"refused": finding.refused} if finding.refused else {}),
        "parameters": parameters(finding_numbers(robot, finding)),
        "meaning": finding.law.effect.meaning(finding.law.parameters),
        "torque_share": {name: share for name, share in shares if share > 0},
        "where": {
            "joint": robot.joints[where.joint],
            **picked(where, "variable region share"),
            **({"time_origin": where.origin} if where.origin else {}),
        },
        "evidence": picked(finding, "statistic threshold held_out_gain"),
        "remainder": {"rms": rest * moved, "unit": result.before.unit[where.joint], "share": rest},
        "alternatives": [
            {"effect": rival.law.effect.name, "joint": law_place(rival.law, robot)[0]}
            | picked(rival, "probability separating_motion")
            for rival in finding.alternatives
        ],
    }


def _ordinary(result: Diagnosis) -> Iterator[Document]:
    """Friction, rotors and offsets that the description does not state: each law with its number at each joint."""
    ordinary = [finding for finding in result.findings if finding.ordinary]
    for effect in dict.fromkeys(finding.law.effect for finding in ordinary):
        alike = [finding for finding in ordinary if finding.law.effect is effect]
        laws = [{x.name: x for x in finding_numbers(result.robot, finding)} for finding in alike]
        yield {
            "effect": effect.name,
            "joints": [law_place(finding.law, result.robot)[0] for finding in alike],
            "parameters": {
                key: {"unit": x.unit, **{y: [getattr(numbers[key], y) for numbers in laws] for y in ("value", "std")}}
                for key, x in laws[0].items()
            },
        }


def diagnosis_tables(result: Diagnosis) -> list[RenderableType]:
    """Verdict, location of the residual, findings, alternatives, unexplained residual and held-out validation."""
    left, unreliable = words.unexplained_words(result), words.is_unreliable(result.flags)
    last = [
        Section("Unexplained residual", (Sentences(left),)),
        *([] if result.signs is None else signs_sections(result.signs)),
        _fit(result),
        _rolled(result),
    ]
    alternatives: list[RenderableType] = []
    rivals = [(finding, words.alternative_words(result.robot, finding)) for finding in result.causes[:MAX_CAUSES]]
    if any(cells for _, cells in rivals):
        alternatives.append(heading("Alternatives that explain the recordings equally well, or nearly"))
    for finding, lines_of_rivals in rivals:
        if lines_of_rivals:
            alternatives.append(paragraph(law_words(result.robot, finding.law)))
            alternatives += map(_indented, lines_of_rivals)
    causes: list[RenderableType] = []
    robot, titles = result.robot, words.role_words(result)
    large, small = words.by_size(result)
    if large:
        causes.append(heading(titles["cause"]))
        for cells in (words.finding_words(robot, finding) for finding in large[:MAX_CAUSES]):
            part, of, joint = cells.torque.partition(" of ")
            torque = f"{part} of the torque{of}{joint}"
            where = [f"mostly {cells.where}"] if cells.where else []
            causes.append(paragraph(", ".join([cells.law, f"probability {cells.probability}", torque, *where])))
            causes += map(_indented, cells.numbers)
        causes += _more(len(large) - MAX_CAUSES)
    if usual := words.ordinary_words(result):
        causes.append(heading(ORDINARY))
        causes += map(paragraph, usual)
    if small:
        causes.append(heading(titles["secondary"]))
        lines = (words.secondary_words(robot, finding) for finding in small[:MAX_CORRECTIONS])
        causes += [Text(line, no_wrap=True, overflow="ellipsis") for line in lines]
        causes += _more(len(small) - MAX_CORRECTIONS)
    return [
        Text(f"{result.robot.name}: {words.verdict_words(result)}", RED if unreliable else STYLES[result.verdict]),
        heading(RESIDUAL),
        *map(paragraph, words.place_words(result, MAX_PLACES)),
        *causes,
        *map(paragraph, words.trust_words(result)),
        *alternatives,
        *map(paragraph, words.power_words(result)),
        *terminal(last, diagnosis_notes(result)),
    ]


def _indented(line: str) -> RenderableType:
    return Padding(paragraph(line), (0, 0, 0, 2), expand=False)


def _more(number: int) -> list[RenderableType]:
    return [paragraph(f"and {plural(number, 'smaller finding')} in diagnosis.json")] if number > 0 else []


def _fit(result: Diagnosis) -> Section:
    """Residual torque of each joint on what was held out, before and after."""
    before, after, rows = result.before, result.after, []
    for j, joint in enumerate(before.joints):
        rms = change(float(before.held_out_rms[j]), float(after.held_out_rms[j]))
        r2 = (determination(float(fit.held_out_r2[j])) for fit in (before, after))
        rows.append((joint, *rms, figure(float(before.irreducible_rms[j]), 2), before.unit[j], *r2))
    heads = ("joint", "before>", "after>", "irreducible>", "unit", "R2 before>", "R2 after>")
    return Section("Held-out data: rms of the residual torque", (Cells(heads, rows),))


def _rolled(result: Diagnosis) -> Section:
    """Position errors of each joint at the end of the longest roll-outs, before and after, if there are any."""
    before, after = result.rollout_before, result.rollout_after
    if before is None or after is None:
        return Section("", ())
    horizon = max(before.horizons)
    errors = (x.rms(horizon).tolist() for x in (before, after))
    rows = [(joint, *change(*rms), unit) for joint, unit, *rms in zip(before.joints, before.unit, *errors, strict=True)]
    title = f"Roll-outs of {horizon:g} s from measured states: rms position error at the end"
    return Section(title, (Cells(("joint", "before>", "after>", "unit"), rows),))


def change(before: float, after: float) -> tuple[str, str]:
    """An error before and after the extension; after in red if clearly larger."""
    shown = figure(after)
    return figure(before), Worse(shown) if after > words.WORSE_ERROR_RATIO * before else shown


def diagnosis_page(result: Diagnosis, inputs: Sequence[Input] = (), command: str = "") -> str:
    """Render report.html of a diagnosis; `inputs` besides the recordings default to the description."""
    floor, order = result.before.irreducible_rms, worst(result.before)
    chosen = [j for j in order if result.before.held_out_rms[j] > UNFOLDED_RESIDUAL_RATIO * floor[j]] or order[:1]
    title, unreliable = f"{result.robot.name}: {words.verdict_words(result)}", words.is_unreliable(result.flags)
    roles = words.role_words(result)
    usual = [_title(result, finding) for finding in result.findings if finding.ordinary]
    corrections = []
    for finding in words.by_size(result)[1]:
        cells = words.finding_words(result.robot, finding)
        corrections.append((_title(result, finding), "; ".join(cells.numbers), *cells[2:]))
    note = (
        f"Residual is measured - predicted torque, low-passed at {figure(result.cutoff)} Hz. Gaps: the joint is at "
        "rest, where dry friction is undetermined. Thick lines: means."
    )
    first, last = result.rollout_before, result.rollout_after
    rolled = first and last and rollout_plots([("before", first, ORANGE, "dot"), ("after", last, BLUE, "solid")])
    drawn = (Legend("Position error, rms over the windows."), Plots(rolled)) if rolled else ()
    joints = words.place_words(result) if len(result.located) > MAX_PLACES else []
    learned, floor = result.train, result.before.irreducible_rms
    before, after = (left / floor for left in (learned.before, learned.after))
    top = hottest(learned, before)
    said = (Sentences(words.place_words(result, MAX_PLACES)), Fold("All joints", joints))
    extended = heat_maps(learned, after, top) if result.findings else ()
    separating: list[Plain | Sentences | Fold] = []
    for finding in result.findings:
        if shown := words.alternative_words(result.robot, finding):
            whole = words.alternative_words(result.robot, finding, None)
            listed = [line for line in shown if line in whole]
            law = sentence_case(subject(named(result.robot, finding.law, finding.std)))
            folded = [line for line in whole if line not in listed]
            separating += (Plain(law), Sentences(listed), Fold(f"{len(folded)} more for {law}", folded))
    sections = [
        Section(roles["cause"], (Laws(list(_law_cards(result))),)),
        Section(ORDINARY, (Sentences(words.ordinary_words(result)), Fold("Each of them", usual))),
        Section(RESIDUAL, said),
        Section("Original simulation", (Plots(heat_maps(learned, before, top)),), level=3),
        Section("Extended simulation", (Plots(extended),), level=3),
        Section("", (Legend(HEAT_LEGEND), Key([("scale", f"1 to {figure(top, 2)} times")]))),
        Section(roles["secondary"], (Cells(CORRECTION_HEADS, corrections),)),
        Section("", (Sentences(words.trust_words(result)),)),
        Section("Alternatives, and motions that would separate them", tuple(separating)),
        Section(words.POWER_TITLE, (Fold("Smallest size of each law", words.smallest_sizes(result)),)),
        Section("Unexplained residual", (Sentences(words.unexplained_words(result)),)),
        _fit(result).beside(Key(KEY), Folds(note, joint_plots(result.held_out, result.before, result.after, chosen))),
        _rolled(result).beside(*drawn),
    ]
    header = Header(
        title,
        f"diagnosis of {result.robot.name}: simulation against recordings",
        [card for card in _cards(result, order[0]) if "-" not in card.figure.split()],
        f"{result.verdict} unreliable" if unreliable else result.verdict,
    )
    content = shared(result, [result.robot], inputs, command) | {"notes": diagnosis_notes(result)}
    return sections_page(header, sections, content)


def _cards(result: Diagnosis, j: int) -> Iterator[Card]:
    """Key figures: residual and R2 of the worst joint, and the most improved roll-out."""
    before, after, joint = result.before, result.after, result.before.joints[j]
    rms = " → ".join(figure(float(fit.held_out_rms[j])) for fit in (before, after))
    floor = f"irreducible {figure(float(before.irreducible_rms[j]), 2)} {before.unit[j]}"
    yield Card(f"residual torque of {joint}, held out", f"{rms} {before.unit[j]}", floor)
    r2 = " → ".join(determination(float(fit.held_out_r2[j])) for fit in (before, after))
    yield Card("R2 of this torque, held out", r2, "1 is perfect")
    first, last = result.rollout_before, result.rollout_after
    if first is not None and last is not None:
        horizon = max(first.horizons)
        errors = first.rms(horizon), last.rms(horizon)
        k = int(np.argmax(np.nan_to_num(errors[0] / np.maximum(errors[1], 1e-300))))
        change = " → ".join(figure(float(rms[k])) for rms in errors)
        title = f"{horizon:g} s roll-outs: position error of {first.joints[k]}"
        yield Card(title, f"{change} {first.unit[k]}", "rms")


def _law_cards(result: Diagnosis) -> Iterator[LawCard]:
    """A card per large finding; what a law is stands in its first card only."""
    described = set[str]()
    for finding in words.by_size(result)[0]:
        effect, cells = finding.law.effect, words.finding_words(result.robot, finding)
        numbers = number_cells(result.robot, finding)
        table = Cells(("parameter", "value>", "± 95 %>", "unit"), [(x.key, x.value, x.half, x.unit) for x in numbers])
        if finding.stated:
            table = Cells(("parameter", "in the simulation>", "recorded>", "± 95 %>", "unit"), numbers)
        near = [(x.law, x.probability) for x in finding.alternatives if x.probability >= words.MIN_SHOWN]
        probable = [(finding.law, finding.probability), *sorted(near, key=lambda pair: -pair[1])[:MAX_DRAWN]]
        rivals = [(law_words(result.robot, law), Bar(confidence(p), 100 * p)) for law, p in probable]
        sure = finding.probability >= MIN_CERTAIN_PROBABILITY
        alone = "No alternative comes close" if sure else "No other law gives half of this torque"
        where = f", mostly {cells.where}" if cells.where else ""
        absent = f"Not in the extended simulation: {finding.refused}".removesuffix(": ")
        evidence = (
            f"{cells.torque} of measured torque (rms){where}. {'' if finding.in_model else f'{absent}. '}"
            f"Reduces the held-out sum of squares by {share(finding.held_out_gain)}. "
            f"Log odds {log_odds(finding.statistic)} (threshold: {log_odds(finding.threshold)})."
        )
        first = effect.name not in described
        described.add(effect.name)
        yield LawCard(
            title=_title(result, finding),
            probability=cells.probability,
            sure=sure,
            summary=" ".join((getdoc(type(effect)) or "").split()) if first else "",
            equation=effect.equation if first else "",
            numbers=table,
            evidence=evidence if len(rivals) > 1 else f"{evidence} {alone}.",
            source=effect.source if first else "",
            rivals=rivals if len(rivals) > 1 else [],
        )


def _title(result: Diagnosis, finding: Finding) -> str:
    """A finding in words, with its main number."""
    return sentence_case(finding_headline(named(result.robot, finding.law, finding.std, finding.stated)))
