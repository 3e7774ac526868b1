"""Closed loops from commands alone: errors in JSON and tables, and validation of models with position drives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.console import RenderableType

from .....types import Input
from ...layout import figure, heading, new_table, note_lines, paragraph, plural
from ..documents import Document, description, ending

if TYPE_CHECKING:
    from .....servo.identify import ServoRollOut
    from .....servo.validate import ServoValidation


def position_fit(found: ServoRollOut) -> Document:
    """Rms position error of closed loops over whole recordings, in the form of a fit."""
    nothing = [None] * len(found.joints)
    return {
        "joints": list(found.joints),
        "unit": list(found.units),
        "train_rms": nothing,
        "held_out_rms": found.whole_rms,
        "noise_floor": nothing,
        "held_out_r2": nothing,
    }


def rollout_document(found: ServoRollOut) -> Document:
    """Rms position error per joint of closed loops from commands alone."""
    return {
        "joints": list(found.joints),
        "whole_rms": found.whole_rms,
        "one_second_rms": found.one_second_rms,
        "nominal": found.nominal,
        "nominal_whole_rms": found.nominal_whole_rms,
        "nominal_one_second_rms": found.nominal_one_second_rms,
        "unit": list(found.units),
        "held_out": found.held_out,
    }


def closed_loop_title(found: ServoRollOut) -> str:
    """Title of a table of closed-loop errors."""
    data = "held-out data" if found.held_out else "data of the fit (none was held out)"
    return f"Closed loop from commands alone, {data}: rms position error"


def closed_loop_rows(found: ServoRollOut) -> tuple[list[str], list[list[str]]]:
    """Table heads and rows: rms of the nominal and of the identified loop, whole recordings and 1 s windows."""
    columns = (found.nominal_whole_rms, found.whole_rms, found.nominal_one_second_rms, found.one_second_rms)
    rows = [
        [joint, *(figure(float(rms[j])) for rms in columns), found.units[j]] for j, joint in enumerate(found.joints)
    ]
    before = f"{found.nominal}" if found.nominal else "before"
    heads = ["joint", f"whole,\n{before}>", "whole,\nidentified>", f"1 s,\n{before}>", "1 s,\nidentified>", "unit"]
    return heads, rows


def servo_validation_document(result: ServoValidation, inputs: Sequence[Input] = ()) -> Document:
    """Build the content of validation.json; `inputs` besides the recordings default to the models' descriptions."""
    return {
        "schema": "signid.validation/1",
        "models": [
            {
                "path": one.name,
                "robot": one.model.robot.name,
                "fit": {**position_fit(one.rollout), "train_rms": None},
                "rollout": {k: x for k, x in rollout_document(one.rollout).items() if k != "held_out"},
            }
            for one in result.models
        ],
        **ending(result, result.inputs, inputs or [description(one.model.robot) for one in result.models], result.seed),
    }


def servo_validation_tables(result: ServoValidation) -> list[RenderableType]:
    """Errors of closed loops of every model, per joint, beside those of q = q_des."""
    listed = [f"{number}  {one.name}" for number, one in enumerate(result.models, 1)]
    heads, rows = validated_loop_rows(result)
    return [
        heading(servo_validation_title(result), below=False),
        *map(paragraph, listed if len(listed) > 1 else []),
        heading("Closed loop from commands alone: rms position error"),
        new_table(*heads, rows=rows),
        paragraph("Over whole recordings, and restarted from the measured state every second. Nothing was fitted."),
        *note_lines(result.notes),
    ]


def servo_validation_title(result: ServoValidation) -> str:
    """Title: models and number of recordings."""
    models = result.models[0].name if len(result.models) == 1 else plural(len(result.models), "model")
    return f"{models}: closed loop validated on {plural(len(result.inputs), 'recording')}"


def validated_loop_rows(result: ServoValidation) -> tuple[list[str], list[list[str]]]:
    """Table heads, and rows with the errors of q = q_des and of every model."""
    several = len(result.models) > 1
    marks = [f" {number}" if several else "" for number in range(1, len(result.models) + 1)]
    first = result.models[0].rollout
    heads = ["joint", f"{first.nominal}>", *(f"whole{m}>" for m in marks), *(f"1 s{m}>" for m in marks), "unit"]
    rows = []
    for j, (joint, unit) in enumerate(zip(first.joints, first.units, strict=True)):
        loops = [one.rollout for one in result.models]
        sizes = [first.nominal_whole_rms, *(r.whole_rms for r in loops), *(r.one_second_rms for r in loops)]
        rows.append([joint, *(figure(float(rms[j])) for rms in sizes), unit])
    return heads, rows
