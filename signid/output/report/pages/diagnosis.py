"""Page of a diagnosis: verdict, location, findings, alternatives and held-out validation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from inspect import getdoc
from typing import TYPE_CHECKING, Any

import numpy as np

from ..layout import confidence, determination, figure
from ..plots.courses import joint_plots, rollout_plots, worst
from ..plots.frame import AFTER, BEFORE, render, shared
from ..plots.heat import heat_maps, hottest
from ..results import sentences as words
from ..results.diagnosis import diagnosis_notes, rollout_errors
from ..results.laws import law_words, number_cells
from ..results.sentences import finding_headline, named, sentence_case, subject
from ..sections import Card, Plot

if TYPE_CHECKING:
    from ....diagnose import Diagnosis, Finding
    from ....types import Input

SURE = 0.95  # probability from which a finding is considered certain
LOUD = 1.5  # ratio of residual to irreducible rms from which a joint is unfolded
PLACES = 8  # maximum number of joints whose residual is located before the others are unfolded
LISTED = 5  # maximum number of alternatives drawn


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
        rivals=list(_alternatives(result)),
        left=words.unexplained_words(result),
        worse=words.WORSE,
        joints=joint_plots(result.held_out, result.before, result.after, chosen or order[:1]),
        rolled=rolled,
        errors=rollout_errors(result),
        notes=diagnosis_notes(result),
        **shared(result, [result.robot], inputs, command),
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


def _alternatives(result: Diagnosis) -> Iterator[tuple[str, list[str], list[str]]]:
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
