"""Page of a validation: key figures of all models, torque over time, roll-outs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ....types import Input
from ..layout import determination, figure
from ..results.validation import joints_of, rollout_rows, rollout_title, torque_rows, validation_title
from .courses import FEWEST, OPEN, POINTS, JointPlots, Line, rollout_plots, torque_plot, worst
from .frame import AFTER, BEFORE, FLOOR, INK, Card, Plot, render, shared

if TYPE_CHECKING:
    from ....validate import ValidatedModel, Validation

COLOURS = (BEFORE, AFTER, FLOOR, "#b3539b", "#7a6ff0", "#8a6d3b")
DASHES = ("solid", "dot", "dash")


def validation_page(result: Validation, inputs: Sequence[Input] = (), command: str = "") -> str:
    """Render report.html of a validation; `inputs` besides the recordings default to the models' descriptions."""
    models, rolled = result.models, validated_rollouts(result)
    return render(
        "validation.html",
        title=validation_title(result),
        names=[(one.name, _style(k)[0]) for k, one in enumerate(models)],
        several=len(models) > 1,
        cards=list(_cards(models)),
        torque=torque_rows(result),
        joints=list(validated_plots(result)),
        errors=rollout_rows(result) if rolled or any(one.whole for one in models) else None,
        errors_title=rollout_title(result),
        rolled=rolled,
        **shared(result, (one.model.robot for one in models), inputs, command),
    )


def _cards(models: Sequence[ValidatedModel]) -> Iterator[Card]:
    """Key figures of each model's worst joint."""
    for one in models:
        j, fit = worst(one.fit)[0], one.fit
        beside = f"noise floor {figure(float(fit.noise_floor[j]), 2)} {fit.unit[j]}"
        r2 = determination(float(fit.held_out_r2[j]))
        rms = f"{figure(float(fit.held_out_rms[j]))} {fit.unit[j]}"
        yield Card(f"{one.name}: rms of its worst joint, {fit.joints[j]}", rms, f"{beside}, R2 {r2}")


def validated_rollouts(result: Validation) -> list[Plot]:
    """Plot the roll-out errors of all models, per joint."""
    runs = [(k, one.rollout) for k, one in enumerate(result.models)]
    return rollout_plots([(f"model{_label(result, k)}", run, *_style(k)) for k, run in runs if run is not None])


def validated_plots(result: Validation) -> Iterator[JointPlots]:
    """Plots per joint; those with the largest residual over noise floor are unfolded."""
    fit = result.models[0].fit
    shown = [fit.joints[j] for j in worst(fit)][:OPEN]
    for joint in joints_of(result.models):
        having = [(k, one) for k, one in enumerate(result.models) if joint in one.fit.joints]
        moving = [(k, one, one.fit.joints.index(joint)) for k, one in having]
        unit = moving[0][1].fit.unit[moving[0][2]]
        rms = ", ".join(figure(float(one.fit.held_out_rms[j])) for _, one, j in moving)
        yield JointPlots(joint, f"rms {rms} {unit}", joint in shown, _plots(result, joint, unit, moving))


def _plots(result: Validation, joint: str, unit: str, moving: Sequence[tuple[int, ValidatedModel, int]]) -> Any:
    """Torque over time of models with the same rows as the first model."""
    _, first, place = moving[0]
    alike = [(k, one, j) for k, one, j in moving if np.array_equal(one.t, first.t)]
    measured = next((one.torque[:, j] for _, one, j in alike if np.isfinite(one.residual[:, j]).any()), None)
    if measured is None:
        return ()
    lines = [Line("measured", "y", INK, {"width": 1.6}, measured)]
    for k, one, j in alike:
        (colour, dash), name = _style(k), _label(result, k)
        style = {"width": 1.3, "dash": dash}
        lines.append(Line(f"predicted{name}", "y", colour, style, measured - one.residual[:, j]))
        lines.append(Line(f"residual{name}", "y2", colour, style, one.residual[:, j]))
    most = max(FEWEST, 3 * POINTS // (len(result.models[0].fit.joints) * (1 + len(lines))))
    return (torque_plot(joint, first, unit, lines, most),)


def _style(k: int) -> tuple[str, str]:
    """Colour and dash of a model."""
    return COLOURS[k % len(COLOURS)], DASHES[k // len(COLOURS) % len(DASHES)]


def _label(result: Validation, k: int) -> str:
    """Label of a model in a plot: its number if there are several."""
    return f" {k + 1}" if len(result.models) > 1 else ""
