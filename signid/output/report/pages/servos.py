"""Page of an identification of position drives: closed loop over time, drives, what is not identifiable."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ....types import Input
from ..layout import figure, plural, share
from ..results.drives.closed_loops import closed_loop_rows, closed_loop_title
from ..results.drives.identification import number_cell, scale_lines, servo_rows, unidentifiable_lines
from .closed_loops import MOST_TRACES, closed_loop_plots, worst_joints
from .frame import Card, render, shared

if TYPE_CHECKING:
    from ....servo.identify import ServoIdentification


def servo_page(result: ServoIdentification, inputs: Sequence[Input] = (), command: str = "") -> str:
    """Render report.html of a servo identification; `inputs` besides the recordings default to the description."""
    counted, lines = plural(len(result.joints), "position drive"), unidentifiable_lines(result.joints)
    return render(
        "servos.html",
        title=f"{result.robot.name}: {counted}",
        sentence=f"{counted} identified from commanded and measured positions",
        cards=list(_cards(result)),
        loops=closed_loop_rows(result.rollout),
        loops_title=closed_loop_title(result.rollout),
        nominal=result.rollout.nominal,
        joints=list(closed_loop_plots(result.traces, result.rollout)),
        fewer=len(result.traces) > MOST_TRACES,
        drives=servo_rows(result),
        laws=list(_laws(result)),
        scale=scale_lines(result),
        shares=[(one.joint, share(one.known_load_share), share(one.saturated_share)) for one in result.joints],
        unidentifiable=lines,
        notes=[note for note in result.notes if note not in lines],
        **shared(result, [result.robot], inputs, command),
    )


def _cards(result: ServoIdentification) -> Iterator[Card]:
    """Key figures of the joint with the largest error after the fit."""
    found = result.rollout
    order = worst_joints(found)
    if not order:
        return
    j = order[0]
    data = "held out" if found.held_out else "data of the fit"
    before = figure(float(found.nominal_whole_rms[j]))
    whole = f"{figure(float(found.whole_rms[j]))} {found.units[j]}"
    yield Card(
        f"closed loop of {found.joints[j]}, whole recordings", whole, f"worst joint, {data}; {found.nominal}: {before}"
    )
    short = f"{figure(float(found.one_second_rms[j]))} {found.units[j]}"
    before = figure(float(found.nominal_one_second_rms[j]))
    yield Card("the same joint, windows of 1 s", short, f"rms position error; {found.nominal}: {before}")
    if one := next((one for one in result.joints if one.joint == found.joints[j]), None):
        kp = one.numbers.get("kp")
        if kp is not None:
            yield Card(f"stiffness kp of {one.joint}", number_cell(kp), f"{kp.unit}, ± 95 %; law {one.law}")


def _laws(result: ServoIdentification) -> Iterator[tuple[str, ...]]:
    """Posterior of each law that was tried, per joint."""
    for one in result.joints:
        for law, probability in sorted(one.laws.items(), key=lambda item: -item[1]):
            yield one.joint, law, ">0.999" if probability > 0.999 else figure(probability)
