"""Validation: JSON document and terminal tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from rich.console import RenderableType

from ....types import Input
from ..layout import determination, figure, heading, new_table, note_lines, paragraph, plural
from .documents import Document, description, ending, fit_document
from .identification import cutoff_words

if TYPE_CHECKING:
    from ....validate import ValidatedModel, Validation


def validation_document(result: Validation, inputs: Sequence[Input] = ()) -> Document:
    """Build the content of validation.json; `inputs` besides the recordings default to the models' descriptions."""
    return {
        "schema": "signid.validation/1",
        "models": [
            {
                "path": one.name,
                "robot": one.model.robot.name,
                "fit": {**fit_document(one.fit), "train_rms": None},
                "rollout": _rollout_document(one, result.horizon),
            }
            for one in result.models
        ],
        "cutoff": {"torque": result.cutoff, "position": result.position_cutoff, "unit": "Hz"},
        **ending(result, result.inputs, inputs or [description(one.model.robot) for one in result.models], result.seed),
    }


def validation_tables(result: Validation) -> list[RenderableType]:
    """Rms, noise floor, R2 and roll-out errors of every model, per joint."""
    listed = [f"{number}  {one.name}" for number, one in enumerate(result.models, 1)]
    (heads, rows), (ends, errors) = torque_rows(result), rollout_rows(result)
    rolled = [heading(rollout_title(result)), new_table(*ends, rows=errors)]
    cutoff = cutoff_words(result.cutoff, result.position_cutoff)
    return [
        heading(validation_title(result), below=False),
        *map(paragraph, listed if len(listed) > 1 else []),
        heading("Torque: rms of measured - predicted"),
        new_table(*heads, rows=rows),
        *(rolled if any(one.rollout or one.whole for one in result.models) else []),
        paragraph(f"{cutoff}; rows where a joint is at rest are excluded. Nothing was fitted."),
        *note_lines(result.notes),
    ]


def _rollout_document(one: ValidatedModel, horizon: float | str) -> Document | None:
    if one.whole is not None:
        rms = [float(x) if np.isfinite(x) else None for x in one.whole.rms]
        return {"horizon": horizon, "rms": rms, "unit": one.whole.unit, "duration": one.whole.seconds}
    if one.rollout is None or isinstance(horizon, str):
        return None
    return {"horizon": horizon, "rms": one.rollout.rms(horizon), "unit": one.rollout.unit}


def rollout_title(result: Validation) -> str:
    """Heading of the table of roll-outs."""
    if isinstance(result.horizon, str):
        return "Simulations of whole recordings under recorded torque: rms position error"
    return f"Roll-outs of {result.horizon:g} s from measured states: rms position error at the end"


def validation_title(result: Validation) -> str:
    """Title: models and number of recordings."""
    models = result.models[0].name if len(result.models) == 1 else plural(len(result.models), "model")
    return f"{models}: validated on {plural(len(result.inputs), 'recording')}"


def torque_rows(result: Validation) -> tuple[list[str], list[list[str]]]:
    """Table heads, and rows with rms, noise floor and R2 of every model, in the order of the models."""
    marks = _marks(result.models)
    heads = ["joint", *(f"rms{m}>" for m in marks), "noise floor>", "unit", *(f"R2{m}>" for m in marks)]
    rows = []
    for joint in joints_of(result.models):
        fits = [(one.fit, _place(one.fit.joints, joint)) for one in result.models]
        rms = ["-" if j is None else figure(float(fit.held_out_rms[j])) for fit, j in fits]
        r2 = ["-" if j is None else determination(float(fit.held_out_r2[j])) for fit, j in fits]
        fit, first = next((fit, j) for fit, j in fits if j is not None)
        rows.append([joint, *rms, figure(float(fit.noise_floor[first]), 2), fit.unit[first], *r2])
    return heads, rows


def rollout_rows(result: Validation) -> tuple[list[str], list[list[str]]]:
    """Table heads, and rows with the rms position error of every model, at the horizon or over whole recordings."""
    heads, rows = ["joint", *(f"error{m}>" for m in _marks(result.models)), "unit"], []
    simulated = [_errors(one, result.horizon) for one in result.models]
    for joint in joints_of(result.models):
        errors = [figure(float(found[joint][0])) if joint in found else "-" for found in simulated]
        rows.append([joint, *errors, next((found[joint][1] for found in simulated if joint in found), "")])
    return heads, rows


def _errors(one: ValidatedModel, horizon: float | str) -> dict[str, tuple[float, str]]:
    """Rms position error and its unit by joint; empty without a simulation."""
    if one.whole is not None:
        found, rms = one.whole, one.whole.rms
        return {joint: (x, u) for joint, x, u in zip(found.joints, rms, found.unit, strict=True)}
    if one.rollout is None or isinstance(horizon, str):
        return {}
    rolled = one.rollout
    return {joint: (x, u) for joint, x, u in zip(rolled.joints, rolled.rms(horizon), rolled.unit, strict=True)}


def joints_of(models: Sequence[ValidatedModel]) -> list[str]:
    """Joints of all models, without repetitions."""
    return list(dict.fromkeys(joint for one in models for joint in one.fit.joints))


def _marks(models: Sequence[ValidatedModel]) -> list[str]:
    """Suffixes of table heads: the numbers of the models if there are several."""
    return [f" {number}" for number in range(1, len(models) + 1)] if len(models) > 1 else [""]


def _place(joints: Sequence[str], joint: str) -> int | None:
    return joints.index(joint) if joint in joints else None
