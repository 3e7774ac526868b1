"""Page of a diagnosis of position drives: verdict, findings, alternatives, closed loops over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ....types import Input
from ..layout import figure
from ..results.drives.diagnosis import (
    LIKELIHOOD,
    REPEATED,
    finding_cells,
    servo_alternatives,
    servo_error_heads,
    servo_errors,
    servo_repeats_sentences,
    servo_unexplained,
    servo_verdict,
)
from .closed_loops import MOST_TRACES, closed_loop_plots, worst_joints
from .frame import Card, render, shared

if TYPE_CHECKING:
    from ....servo.diagnose import ServoDiagnosis


def servo_diagnosis_page(result: ServoDiagnosis, inputs: Sequence[Input] = (), command: str = "") -> str:
    """Render report.html of a diagnosis of drives; `inputs` besides the recordings default to the description."""
    return render(
        "drives.html",
        title=f"{result.robot.name}: {servo_verdict(result)}",
        cards=list(_cards(result)),
        heads=list(LIKELIHOOD),
        findings=[[one.effect, one.joint, *finding_cells(one)] for one in result.findings],
        meanings=[f"{one.effect} at {one.joint}: {one.meaning}" for one in result.findings],
        rivals=servo_alternatives(result),
        left=servo_unexplained(result),
        repeated=REPEATED,
        repeats=servo_repeats_sentences(result),
        error_heads=servo_error_heads(),
        errors=list(servo_errors(result)),
        joints=list(closed_loop_plots(result.traces, result.rollout_after)),
        fewer=len(result.traces) > MOST_TRACES,
        **shared(result, [result.robot], inputs, command),
    )


def _cards(result: ServoDiagnosis) -> Iterator[Card]:
    """Error of the worst joint before and after."""
    before, after = result.rollout_before, result.rollout_after
    for j in worst_joints(before)[:1]:
        rms = " → ".join(figure(float(x.whole_rms[j])) for x in (before, after))
        yield Card(f"closed loop of {before.joints[j]}, held out", f"{rms} {before.units[j]}", "whole recordings, rms")
        rms = " → ".join(figure(float(x.one_second_rms[j])) for x in (before, after))
        yield Card("the same joint, windows of 1 s", f"{rms} {before.units[j]}", "rms position error")
