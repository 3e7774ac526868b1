"""Diagnosis of position drives: JSON document, terminal tables and page; mismatches in rad or m."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from rich.console import RenderableType
from rich.text import Text

from ....servo.diagnose.conclude import VISIBLE
from ....servo.identify.fits import HORIZON
from ....types import Input
from ..documents import Document, description, ending, fit_document, opening, picked
from ..layout import figure, share, thousandths
from ..pages import Header, sections_page, shared
from ..plots import loop_blocks, worst_joints
from ..quantities import Quantity, parameters
from ..sections import Card, Cells, Section, Sentences, terminal
from .servo_identification import all_joints, loop_units, poor_joints

if TYPE_CHECKING:
    from ....servo.diagnose import ServoDiagnosis, ServoFinding

VERDICT_SENTENCES = {
    "nothing_missing": "nothing is missing: the simulation predicts the motion within the noise of the positions, or "
    f"{100 * VISIBLE:.0f} % of the tracking error",
    "unknown": "the simulation and the recordings differ, and no law explains the difference",
}
FINDING_HEADS = ("law", "joint", "numbers, ± 95 %", "stated>", "probability>", "mismatch explained>", "held-out gain>")
RATIO, MIN_SHARE = 0.75, 0.05  # [1] of the best share explained, and share, from which laws count as not separated
MAX_SHOWN_PROBABILITY = 0.999  # probability that is shown as > 99.9 %


def servo_diagnosis_document(result: ServoDiagnosis, inputs: Sequence[Input] = ()) -> Document:
    """Build the content of diagnosis.json; `inputs` besides the recordings default to the robot description."""
    before, after, repeats = result.rollout_before, result.rollout_after, result.repeats
    differences = {} if repeats is None else picked(repeats, "rms mismatch_rms share")
    return {
        **opening("signid.diagnosis/1", result.robot),
        "verdict": result.verdict,
        "findings": [
            {
                **picked(finding, "effect joint role probability"),
                "parameters": parameters(found_numbers(finding)),
                "meaning": finding.meaning,
                "torque_share": dict(finding.share),
                "where": picked(finding, "joint variable region"),
                "evidence": picked(finding, "statistic threshold held_out_gain"),
                "alternatives": [picked(x, "effect joint probability separating_motion") for x in finding.alternatives],
            }
            for finding in result.findings
        ],
        "unexplained": [
            {"depends_on": x.variable, **picked(x, "joint share rms region region_rms"), "tried": dict(x.tried)}
            for x in result.unexplained
        ],
        "fit": {"before": fit_document(result.before), "after": fit_document(result.after)},
        "rollout": {
            "horizon": HORIZON,
            "before_rms": before.one_second_rms.tolist(),
            "after_rms": after.one_second_rms.tolist(),
            "before_whole_rms": before.whole_rms.tolist(),
            "after_whole_rms": after.whole_rms.tolist(),
            "unit": list(before.units),
        },
        "repeats": repeats
        and {
            **picked(repeats, "pairs seconds"),
            "joints": list(repeats.joints),
            **{key: size.tolist() for key, size in differences.items()},
        },
        **ending(result, result.inputs, inputs or [description(result.robot)], result.seed),
    }


def found_numbers(finding: ServoFinding) -> list[Quantity]:
    """Parameters of a finding, from which all outputs follow."""
    law = finding.joint, finding.effect, None
    return [Quantity(key, x.value, x.std, x.unit, *law, x.stated) for key, x in finding.parameters.items()]


def servo_diagnosis_tables(result: ServoDiagnosis) -> list[RenderableType]:
    """Verdict, findings, alternatives, unexplained mismatch, and errors before and after."""
    verdict = Text(_title(result), "bold red" if poor_joints(result.rollout_after) else "bold")
    rivals = Section("Alternatives", (Sentences(_alternatives(result)),))
    sections = [_findings(result), rivals, _unexplained(result), _repeated(result), _errors(result)]
    return [verdict, *terminal(sections, result.notes)]


def servo_diagnosis_page(result: ServoDiagnosis, inputs: Sequence[Input] = (), command: str = "") -> str:
    """Render report.html of a diagnosis of drives; `inputs` besides the recordings default to the description."""
    over = f"diagnosis of {result.robot.name}: position drives from commands and positions, without torque"
    drawn = replace(result.rollout_after, nominal_whole_rms=result.rollout_before.whole_rms)  # as the curves are
    loops = loop_blocks(result.traces, drawn, "given simulation", "extended simulation")
    sections = [
        _findings(result).beside(Sentences([f"{x.effect} at {x.joint}: {x.meaning}" for x in result.findings])),
        Section("Alternatives, and the motion that separates them", (Sentences(_alternatives(result)),)),
        _unexplained(result),
        _repeated(result),
        _errors(result).beside(*loops),
    ]
    kind = "unreliable" if poor_joints(result.rollout_after) else result.verdict
    cards = []
    before, after = result.rollout_before, result.rollout_after
    for unit, tracking in all_joints(before, before.tracking_rms).items():
        errors = [all_joints(x, x.whole_rms)[unit] for x in (before, after)]
        rms = " → ".join(thousandths(x, 2) for x in errors)
        part = " → ".join(share(x / tracking) for x in errors if tracking > 0)
        cards.append(
            Card("closed loop, held out, whole recordings", f"{rms} m{unit} rms", f"{part} of the tracking error")
        )
    for j in worst_joints(before)[:1] if len(before.joints) > 1 else ():
        rms = " → ".join(thousandths(float(x.whole_rms[j])) for x in (before, after))
        cards.append(Card(f"worst joint: {before.joints[j]}", f"{rms} m{before.units[j]} rms", "whole recordings"))
    header = Header(_title(result), over, cards, kind)
    return sections_page(header, sections, shared(result, [result.robot], inputs, command))


def _title(result: ServoDiagnosis) -> str:
    """The verdict as a sentence."""
    causes = ", ".join(f"{cause.effect} at {cause.joint}" for cause in result.causes)
    verdict = VERDICT_SENTENCES.get(result.verdict) or f"missing or wrongly stated: {causes}"
    return f"{result.robot.name}: {verdict}"


def _findings(result: ServoDiagnosis) -> Section:
    """Numbers, stated values, probability, share of the mismatch and held-out gain of each finding."""
    rows = []
    for finding in result.findings:
        numbers = [f"{x.name} {x.text} {x.unit}".removesuffix(" 1") for x in found_numbers(finding)]
        stated = ["-" if x.stated is None else figure(x.stated) for x in found_numbers(finding)]
        sure = "> 99.9 %" if finding.probability > MAX_SHOWN_PROBABILITY else share(finding.probability)
        shares = share(finding.share.get(finding.joint, 0.0)), share(max(finding.held_out_gain, 0.0))
        rows.append([finding.effect, finding.joint, "; ".join(numbers), "; ".join(stated), sure, *shares])
    return Section("Missing or wrongly stated", (Cells(FINDING_HEADS, rows),))


def _alternatives(result: ServoDiagnosis) -> list[str]:
    """A sentence for each alternative of a cause."""
    return [
        f"{cause.effect} at {cause.joint} or {rival.effect} at {rival.joint} (probability {share(rival.probability)}): "
        f"{rival.separating_motion}"
        for cause in result.causes
        for rival in cause.alternatives
    ]


def _unexplained(result: ServoDiagnosis) -> Section:
    """Sentences for each joint with mismatch that no law explains: its size, where it is, what was tried."""
    units = dict(zip(result.rollout_after.joints, result.rollout_after.units, strict=True))
    sentences = []
    for left in result.unexplained:
        unit = units[left.joint]
        sentences.append(
            f"{left.joint}: {thousandths(left.rms)} m{unit} rms remain over windows, {share(left.share)} of the "
            f"mismatch before; it depends most on {left.variable}: {thousandths(left.region_rms)} m{unit} in the "
            f"{left.region}"
        )
        if left.tried:
            laws = ", ".join(f"{effect} {share(max(part, 0.0))}" for effect, part in left.tried.items())
            sentences.append(f"{left.joint}: fitted and not added, with the share of the mean square explained: {laws}")
            best = max(left.tried.values())
            if len(alike := [effect for effect, part in left.tried.items() if part > max(RATIO * best, MIN_SHARE)]) > 1:
                sentences.append(f"{left.joint}: these recordings do not separate {', '.join(alike)}")
    return Section("Unexplained mismatch", (Sentences(sentences),))


def _repeated(result: ServoDiagnosis) -> Section:
    """A sentence for each joint: how far repeats of one command differ, beside the mismatch on the same rows."""
    found, said = result.repeats, list[str]()
    if found is not None:
        units = dict(zip(result.rollout_after.joints, result.rollout_after.units, strict=True))
        said = [
            f"{joint}: repeats of the same command differ by {thousandths(float(rms))} m{units[joint]} rms "
            f"({found.pairs} pairs, {figure(found.seconds)} s); the mismatch there is "
            f"{thousandths(float(mismatch))} m{units[joint]}, so no "
            f"model of these commands explains {share(float(part))} of its mean square"
            for joint, rms, mismatch, part in zip(found.joints, found.rms, found.mismatch_rms, found.share, strict=True)
        ]
    return Section("Repeats of one command", (Sentences(said),))


def _errors(result: ServoDiagnosis) -> Section:
    """Errors of each joint before and after, over whole recordings, 1 s and the windows of the search."""
    pairs = (head for span in ("whole", "1 s", "windows") for head in (f"{span}: before>", "after>"))
    a, b = result.rollout_before, result.rollout_after
    sizes = (a.whole_rms, b.whole_rms, a.one_second_rms, b.one_second_rms)
    fits = (result.before.held_out_rms, result.after.held_out_rms, result.after.noise_floor)
    rows = [[joint, *(thousandths(float(x[j])) for x in (*sizes, *fits))] for j, joint in enumerate(a.joints)]
    title = f"Held-out data: rms position error of closed loops from commands alone [{loop_units(a)}]"
    return Section(title, (Cells(["joint", *pairs, "noise>"], rows),))
