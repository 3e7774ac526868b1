"""Validation of models by torque, or by closed loops from commands alone: JSON document, terminal tables and page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from ....types import Input
from ..documents import Document, description, ending, fit_document
from ..layout import determination, figure, heading, paragraph, plural, thousandths
from ..pages import BLUE, GREEN, ORANGE, Header, sections_page, shared
from ..plots import MAX_OPEN, Line, line_points, loop_blocks, rollout_plots, torque_plot, worst, worst_joints
from ..sections import INK, Card, Cells, Folds, JointPlots, Key, Legend, Plain, Plot, Plots, Section, terminal
from .identification import cutoff_words
from .servo_identification import (
    LOOP_HEADS,
    all_joints,
    loop_cells,
    loop_units,
    loop_words,
    poor_joints,
    position_fit,
    rollout_document,
)

if TYPE_CHECKING:
    from ....servo.validate import ServoValidation
    from ....validate import ValidatedModel, Validation

MODEL_COLOURS = (ORANGE, BLUE, GREEN, "#b3539b", "#7a6ff0", "#8a6d3b")
MODEL_DASHES = ("solid", "dot", "dash")
LOOP_NOTE = "Over whole recordings, and restarted from the measured state every second. Nothing was fitted."


def validation_document(result: Validation, inputs: Sequence[Input] = ()) -> Document:
    """Build the content of validation.json; `inputs` besides the recordings default to the models' descriptions."""
    models = [
        {"fit": {**fit_document(model.fit), "train_rms": None}, "rollout": _rollout_document(model, result.horizon)}
        for model in result.models
    ]
    cutoff = {"torque": result.cutoff, "position": result.position_cutoff, "unit": "Hz"}
    return _document(result, models, inputs, {"cutoff": cutoff})


def servo_validation_document(result: ServoValidation, inputs: Sequence[Input] = ()) -> Document:
    """Build the content of validation.json; `inputs` besides the recordings default to the models' descriptions."""
    models = [
        {"fit": {**position_fit(model.rollout), "train_rms": None}, "rollout": rollout_document(model.rollout)}
        for model in result.models
    ]
    return _document(result, models, inputs, {})


def _document(result: Any, models: Sequence[Document], inputs: Sequence[Input], more: Document) -> Document:
    """Document with the content of each model."""
    return {
        "schema": "signid.validation/1",
        "models": [
            {"path": model.name, "robot": model.model.robot.name, **content}
            for model, content in zip(result.models, models, strict=True)
        ],
        **more,
        **ending(result, result.inputs, inputs or [description(x.model.robot) for x in result.models], result.seed),
    }


def _rollout_document(model: ValidatedModel, horizon: float | str) -> Document | None:
    if (whole := model.whole) is not None:
        rms = [float(x) if np.isfinite(x) else None for x in whole.rms]
        return {"horizon": horizon, "rms": rms, "unit": whole.unit, "duration": whole.seconds}
    if model.rollout is None or isinstance(horizon, str):
        return None
    return {"horizon": horizon, "rms": model.rollout.rms(horizon), "unit": model.rollout.unit}


def validation_tables(result: Validation) -> list[RenderableType]:
    """Rms, noise floor, R2 and roll-out errors of every model, per joint."""
    cutoff = cutoff_words(result.cutoff, result.position_cutoff)
    last = Section("", (Plain(f"{cutoff}; rows where a joint is at rest are excluded. Nothing was fitted."),))
    top = [heading(_title(result, "validated"), below=False), *_listed(result)]
    return [*top, *terminal([_torque(result), _rolled(result), last], result.notes)]


def servo_validation_tables(result: ServoValidation) -> list[RenderableType]:
    """Errors of closed loops of every model, per joint, beside those of q = q_des."""
    loops = _loops(result).beside(Plain(LOOP_NOTE))
    title = Text(_loop_title(result), "bold red" if _is_poor(result) else "bold")
    return [title, *_listed(result), *terminal([loops], result.notes)]


def validation_page(result: Validation, inputs: Sequence[Input] = (), command: str = "") -> str:
    """Render report.html of a validation; `inputs` besides the recordings default to the models' descriptions."""
    over = "validation of given models on recordings, without fitting"
    marks = [
        (_style(k)[0], f"{k + 1}: {model.name}" if len(result.models) > 1 else model.name)
        for k, model in enumerate(result.models)
    ]
    key, torque, named = Key([("measured", "measured"), *marks]), _torque(result), _marks(result.models)
    rolled = rollout_plots(
        [
            (f"model{named[k]}", model.rollout, *_style(k))
            for k, model in enumerate(result.models)
            if model.rollout is not None
        ]
    )
    note = (
        f"Residual is measured - predicted torque, low-passed at {figure(result.cutoff)} Hz. Rows where a joint is at "
        "rest are excluded, since dry friction is undetermined there."
    )
    drawn = (Legend("Rms position error over time."), key, Plots(rolled)) if rolled else ()
    sections = [
        torque._replace(blocks=(key, *torque.blocks, Folds(note, list(validated_plots(result))))),
        _rolled(result).beside(*drawn),
    ]
    cards = []
    for model in result.models:
        j, fit = worst(model.fit)[0], model.fit
        beside = f"noise floor {figure(float(fit.noise_floor[j]), 2)} {fit.unit[j]}"
        r2 = determination(float(fit.held_out_r2[j]))
        rms = f"{figure(float(fit.held_out_rms[j]))} {fit.unit[j]}"
        cards.append(Card(f"{model.name}: rms of its worst joint, {fit.joints[j]}", rms, f"{beside}, R2 {r2}"))
    header = Header(_title(result, "validated"), over, cards)
    return sections_page(header, sections, shared(result, (x.model.robot for x in result.models), inputs, command))


def servo_validation_page(result: ServoValidation, inputs: Sequence[Input] = (), command: str = "") -> str:
    """Render report.html of a validation; `inputs` besides the recordings default to the models' descriptions."""
    models, sections, cards = result.models, [_loops(result)], []
    for number, model in enumerate(models, 1):
        found = model.rollout
        key, *folds = loop_blocks(model.traces, found, models[0].rollout.nominal, "model") or (Key(()),)
        sections += [Section("", (key,))] if number == 1 else []
        sections.append(Section(f"{number}: {model.name}" if len(models) > 1 else "", tuple(folds), level=3))
        for j in worst_joints(found)[:1] if len(models) > 1 or len(found.joints) > 1 else ():
            errors = (found.whole_rms, found.one_second_rms, found.nominal_whole_rms)
            size, short, usual = (thousandths(float(rms[j])) for rms in errors)
            beside = f"{short} restarted every second; {usual} by {found.nominal}"
            cards.append(Card(f"{model.name}: worst joint, {found.joints[j]}", f"{size} m{found.units[j]} rms", beside))
    over = "validation of models with position drives, from commands alone, without fitting"
    kind = "unreliable" if _is_poor(result) else ""
    header = Header(_title(result, "closed loop validated"), over, cards, kind, _loop_title(result))
    return sections_page(header, sections, shared(result, (x.model.robot for x in models), inputs, command))


def _title(result: Any, what: str) -> str:
    """Title: models and number of recordings."""
    models = result.models[0].name if len(result.models) == 1 else plural(len(result.models), "model")
    return f"{models}: {what} on {plural(len(result.inputs), 'recording')}"


def _loop_title(result: ServoValidation) -> str:
    """How well the loops of the only model are predicted, or of the best one of several."""
    best = min(
        result.models, key=lambda model: sum(x**2 for x in all_joints(model.rollout, model.rollout.whole_rms).values())
    )
    name = best.name if len(result.models) == 1 else f"{plural(len(result.models), 'model')}, best {best.name}"
    on = f"on {plural(len(result.inputs), 'recording')}"
    return f"{name}: {plural(len(best.model.servos), 'drive')}, {loop_words(best.rollout)} {on}"


def _is_poor(result: ServoValidation) -> bool:
    """Whether a model predicts a joint badly."""
    return any(poor_joints(model.rollout) for model in result.models)


def _listed(result: Any) -> list[RenderableType]:
    """Several models with their numbers."""
    listed = [f"{number}  {model.name}" for number, model in enumerate(result.models, 1)]
    return [paragraph(line) for line in (listed if len(listed) > 1 else [])]


def _torque(result: Validation) -> Section:
    """Rms, noise floor and R2 of every model, in the order of the models."""
    marks, rows = _marks(result.models), []
    for joint in _joints(result.models):
        quality = [model.fit for model in result.models]
        fits = [(fit, fit.joints.index(joint) if joint in fit.joints else None) for fit in quality]
        rms = ["-" if j is None else figure(float(fit.held_out_rms[j])) for fit, j in fits]
        r2 = ["-" if j is None else determination(float(fit.held_out_r2[j])) for fit, j in fits]
        fit, first = next((fit, j) for fit, j in fits if j is not None)
        rows.append([joint, *rms, figure(float(fit.noise_floor[first]), 2), fit.unit[first], *r2])
    heads = ["joint", *(f"rms{m}>" for m in marks), "noise floor>", "unit", *(f"R2{m}>" for m in marks)]
    return Section("Torque: rms of measured - predicted", (Cells(heads, rows),))


def _rolled(result: Validation) -> Section:
    """Rms position error of every model, at the horizon or over whole recordings."""
    if isinstance(result.horizon, str):
        title = "Simulations of whole recordings under recorded torque: rms position error"
    else:
        title = f"Roll-outs of {result.horizon:g} s from measured states: rms position error at the end"
    simulated, rows = [_errors(model, result.horizon) for model in result.models], []
    for joint in _joints(result.models):
        errors = [figure(float(found[joint][0])) if joint in found else "-" for found in simulated]
        rows.append([joint, *errors, next((found[joint][1] for found in simulated if joint in found), "")])
    heads = ["joint", *(f"error{m}>" for m in _marks(result.models)), "unit"]
    return Section(title, (Cells(heads, rows if any(model.rollout or model.whole for model in result.models) else ()),))


def _errors(model: ValidatedModel, horizon: float | str) -> Mapping[str, tuple[float, str]]:
    """Rms position error and its unit by joint; empty without a simulation."""
    if model.whole is not None:
        joints, rms, units = model.whole.joints, model.whole.rms, model.whole.unit
    elif model.rollout is not None and not isinstance(horizon, str):
        joints, rms, units = model.rollout.joints, model.rollout.rms(horizon), model.rollout.unit
    else:
        return {}
    return dict(zip(joints, zip(rms, units, strict=True), strict=True))


def _loops(result: ServoValidation) -> Section:
    """Tracking error, and errors of every model and their shares of it."""
    loops = [model.rollout for model in result.models]
    units, tracking = loop_units(loops[0]), loops[0].tracking_rms
    names = [f"{name}{mark}" for mark in _marks(result.models) for name in LOOP_HEADS]
    heads = [f"{name}>" if LOOP_HEADS[1] in name else f"{name}\n[{units}]>" for name in ("tracking", *names)]
    rows = [
        [joint, thousandths(float(tracking[j])), *(cell for loop in loops for cell in loop_cells(loop, j))]
        for j, joint in enumerate(loops[0].joints)
    ]
    return Section("Closed loop from commands alone: rms position error", (Cells(["joint", *heads], rows),))


def _joints(models: Sequence[ValidatedModel]) -> list[str]:
    """Joints of all models, without repetitions."""
    return list(dict.fromkeys(joint for model in models for joint in model.fit.joints))


def _marks(models: Sequence[Any]) -> list[str]:
    """Suffixes of the names of the models: their numbers if there are several."""
    return [f" {number}" for number in range(1, len(models) + 1)] if len(models) > 1 else [""]


def validated_plots(result: Validation) -> Iterator[JointPlots]:
    """Plots per joint; those with the largest residual over noise floor are unfolded."""
    fit = result.models[0].fit
    shown = [fit.joints[j] for j in worst(fit)][:MAX_OPEN]
    for joint in _joints(result.models):
        having = [(k, model) for k, model in enumerate(result.models) if joint in model.fit.joints]
        moving = [(k, model, model.fit.joints.index(joint)) for k, model in having]
        unit = moving[0][1].fit.unit[moving[0][2]]
        rms = ", ".join(figure(float(model.fit.held_out_rms[j])) for _, model, j in moving)
        first, marks = moving[0][1], _marks(result.models)
        alike = [(k, model, j) for k, model, j in moving if np.array_equal(model.t, first.t)]
        measured = next((model.torque[:, j] for _, model, j in alike if np.isfinite(model.residual[:, j]).any()), None)
        plots: tuple[Plot, ...] = ()
        if measured is not None:
            lines = [Line("measured", "y", INK, {"width": 1.6}, measured)]
            for k, model, j in alike:
                colour, dash = _style(k)
                style = {"width": 1.3, "dash": dash}
                lines.append(Line(f"predicted{marks[k]}", "y", colour, style, measured - model.residual[:, j]))
                lines.append(Line(f"residual{marks[k]}", "y2", colour, style, model.residual[:, j]))
            max_points = line_points(len(result.models[0].fit.joints) * (1 + len(lines)), 3)
            plots = (torque_plot(joint, first, unit, lines, max_points),)
        yield JointPlots(joint, f"rms {rms} {unit}", joint in shown, plots)


def _style(k: int) -> tuple[str, str]:
    """Colour and dash of a model."""
    return MODEL_COLOURS[k % len(MODEL_COLOURS)], MODEL_DASHES[k // len(MODEL_COLOURS) % len(MODEL_DASHES)]
