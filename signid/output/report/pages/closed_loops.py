"""Plots of closed loops from commands alone, and the page of a validation of models with position drives."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ....types import Array, Input
from ..layout import figure
from ..policy import plot_markup
from ..results.drives.closed_loops import servo_validation_title, validated_loop_rows
from .courses import FEWEST, GAP, OPEN, POINTS, TOP, JointPlots, Line
from .frame import AFTER, BEFORE, FAINT, FLOOR, INK, Card, Plot, axis, curve, packed, render, shared, thinned

if TYPE_CHECKING:
    from ....servo.identify import ServoRollOut, ServoTrace
    from ....servo.validate import ServoValidation

POSITION = "$name: %{y:.5g} $unit at %{x:.5g} s<extra></extra>"
SPAN = 6.0  # largest drawn error, as a multiple of the largest error of the identified loop
MOST_TRACES = 4  # maximum number of recordings that are drawn


def worst_joints(found: ServoRollOut) -> list[int]:
    """Joints with commands in descending order of the error of whole recordings."""
    order = np.argsort(-np.nan_to_num(found.whole_rms, nan=-1.0, posinf=1e300), kind="stable")
    return [int(j) for j in order if not np.isnan(found.whole_rms[j])]


def closed_loop_plots(traces: Sequence[ServoTrace], found: ServoRollOut) -> Iterator[JointPlots]:
    """Positions over time per joint: whole recordings and windows of 1 s; the worst joints are unfolded."""
    order = worst_joints(found)
    drawn = traces[:MOST_TRACES]
    lines = 6 * max(1, len(drawn)) * 2
    most = max(FEWEST, 6 * POINTS // (lines * max(1, len(order))))
    for j in order:
        joint, unit = found.joints[j], found.units[j]
        plots = [plot for trace in drawn if joint in trace.joints for plot in _plots(trace, joint, unit, most)]
        sizes = (found.nominal_whole_rms[j], found.whole_rms[j])
        summary = " → ".join(figure(float(rms)) for rms in sizes)
        yield JointPlots(joint, f"{summary} {unit}, whole recordings", j in order[:OPEN], tuple(plots))


def _plots(trace: ServoTrace, joint: str, unit: str, most: int) -> Iterator[Plot]:
    j = trace.joints.index(joint)
    command, measured, nominal = trace.command[:, j], trace.measured[:, j], trace.nominal[:, j]
    whole = trace.simulated[:, j]
    given = [
        Line("command", "y", FLOOR, {"width": 1.2, "dash": "dash", "shape": "hv"}, command),
        Line("measured", "y", INK, {"width": 1.6}, measured),
    ]
    before = [
        Line("before", "y", BEFORE, {"width": 1.3, "dash": "dot"}, nominal),
        Line("measured - before", "y2", BEFORE, {"width": 1.2, "dash": "dot"}, measured - nominal),
    ]
    after = [
        Line("identified", "y", AFTER, {"width": 1.4}, whole),
        Line("measured - identified", "y2", AFTER, {"width": 1.2}, measured - whole),
    ]
    name = trace.path.rpartition("/")[2] or "recording"
    yield _positions(
        f"{joint}, {name}: whole recording from commands alone", trace.t, unit, [*given, *before, *after], most
    )
    if trace.one_second is not None:
        short = trace.one_second[:, j]
        after = [
            Line("identified", "y", AFTER, {"width": 1.4}, short),
            Line("measured - identified", "y2", AFTER, {"width": 1.2}, measured - short),
        ]
        title = f"{joint}, {name}: restarted from the measured state every second"
        yield _positions(title, trace.t, unit, [*given, *after], most)


def _positions(title: str, t: Array, unit: str, lines: Sequence[Line], most: int) -> Plot:
    """Plot positions over time, with errors below."""
    values = np.column_stack([np.where(np.isfinite(line.values), line.values, np.nan) for line in lines])
    t, values = thinned(t - t[:1], values, np.zeros(1, dtype=np.intp), most)
    data = []
    for line, y in zip(lines, values.T, strict=True):
        hover = plot_markup(POSITION, name=line.name, unit=unit)
        style = {"color": line.colour, **line.style}
        data.append({**curve(line.name, packed(t), packed(y), style, hovertemplate=hover), "yaxis": line.axis})
    errors = {line.name: np.nanmax(np.abs(y), initial=0.0) for line, y in zip(lines, values.T, strict=True)}
    span = SPAN * float(errors["measured - identified"])
    cut = {"range": [-span, span]} if 0 < span < errors.get("measured - before", 0.0) else {}
    layout = {
        "xaxis": axis("time [s]", anchor="y2"),
        "yaxis": axis(f"position [{unit}]", domain=[TOP + GAP, 1], nticks=6),
        "yaxis2": axis(f"error [{unit}]", domain=[0, TOP - GAP], nticks=5, zeroline=True, zerolinecolor=FAINT, **cut),
    }
    return Plot(title, data, layout, 360, wide=True)


def servo_validation_page(result: ServoValidation, inputs: Sequence[Input] = (), command: str = "") -> str:
    """Render report.html of a validation; `inputs` besides the recordings default to the models' descriptions."""
    models = [
        {
            "name": one.name,
            "joints": list(closed_loop_plots(one.traces, one.rollout)),
            "fewer": len(one.traces) > MOST_TRACES,
        }
        for one in result.models
    ]
    return render(
        "closed_loops.html",
        title=servo_validation_title(result),
        cards=list(_cards(result)),
        loops=validated_loop_rows(result),
        models=models,
        nominal=result.models[0].rollout.nominal,
        **shared(result, (one.model.robot for one in result.models), inputs, command),
    )


def _cards(result: ServoValidation) -> Iterator[Card]:
    """Key figures of each model's worst joint."""
    for one in result.models:
        found = one.rollout
        for j in worst_joints(found)[:1]:
            size = f"{figure(float(found.whole_rms[j]))} {found.units[j]}"
            beside = f"{figure(float(found.one_second_rms[j]))} in 1 s; {figure(float(found.nominal_whole_rms[j]))} of "
            yield Card(f"{one.name}: worst joint, {found.joints[j]}", size, f"{beside}{found.nominal}")
