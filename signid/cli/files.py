"""Output of an identification, a diagnosis or a validation: files in a folder and text on the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..errors import RobotError
from .output import list_written
from .terminal import write_flags

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ..diagnose import Diagnosis
    from ..identify import Identification
    from ..output.report import Content
    from ..signs import Signs
    from ..types import Array, Input, Law, Recording, Robot
    from ..validate import Validation


FRICTION = ("viscous_friction", "coulomb_friction")


def deliver(result: Identification, inputs: Sequence[Input], output: str | None, json: bool, command: str) -> int:
    """Write and print an identification; return the exit code.

    Args:
        result: identification.
        inputs: files read besides the recordings.
        output: output folder, if any.
        json: print the document instead of the tables.
        command: shell line that reproduces the result.
    """
    from ..output.report import identification_document, identification_page, identification_tables, to_json

    files: dict[str, Content] = {}
    if output is not None:
        described, notes = _urdf(result.robot, _identifiable_bodies(result), result.model.laws)
        result = replace(result, notes=(*result.notes, *notes))
        signed = _signed(result.signs, result.recordings, result.robot)
        files = {**described, "report.html": identification_page(result, inputs, command), **signed}
    document = to_json(identification_document(result, inputs))
    files = {"identification.json": document, "model.json": to_json(result.model.document()), **files}
    shown = document if json else identification_tables(result)
    return _hand_over(shown, files, result.flags, output)


def deliver_diagnosis(result: Diagnosis, inputs: Sequence[Input], output: str | None, json: bool, command: str) -> int:
    """Write and print a diagnosis; return the exit code.

    Args:
        result: diagnosis.
        inputs: files read besides the recordings.
        output: output folder, if any.
        json: print the document instead of the tables.
        command: shell line that reproduces the result.
    """
    from ..output.report import diagnosis_document, diagnosis_tables, to_json

    files: dict[str, Content] = {}
    if output is not None:
        result, files = diagnosis_files(result, inputs, command)
    document = to_json(diagnosis_document(result, inputs))
    files = {"diagnosis.json": document, **files}
    return _hand_over(document if json else diagnosis_tables(result), files, result.flags, output)


def diagnosis_files(result: Diagnosis, inputs: Sequence[Input], command: str) -> tuple[Diagnosis, dict[str, Content]]:
    """Return the diagnosis with notes on the limits of file formats, and its files besides diagnosis.json.

    Args:
        result: diagnosis.
        inputs: files read besides the recordings.
        command: shell line that reproduces the result.
    """
    from ..output.report import diagnosis_page, to_json

    described, notes = _extended_urdf(result)
    result = replace(result, notes=(*result.notes, *notes))
    signed = _signed(result.signs, result.recordings, result.robot)
    model = to_json(result.model.document())
    page = diagnosis_page(result, inputs, command)
    return result, {"model.json": model, **described, "report.html": page, **signed}


def deliver_validation(found: Validation, inputs: Sequence[Input], output: str | None, json: bool, command: str) -> int:
    """Write and print a validation; return the exit code.

    Args:
        found: validation.
        inputs: files read besides the recordings.
        output: output folder, if any.
        json: print the document instead of the tables.
        command: shell line that reproduces the result.
    """
    from ..output.report import to_json, validation_document, validation_page, validation_tables

    document = to_json(validation_document(found, inputs))
    page = {} if output is None else {"report.html": validation_page(found, inputs, command)}
    files = {"validation.json": document, **page}
    return _hand_over(document if json else validation_tables(found), files, found.flags, output)


def _hand_over(
    shown: str | Sequence[RenderableType], files: Mapping[str, Content], flags: Sequence[str], output: str | None
) -> int:
    """Write files, print the JSON document or the tables, and report flags."""
    from ..output.report import Screen, write_files

    written = [] if output is None else write_files(output, files)
    if isinstance(shown, str):
        Screen().write(shown)
        return write_flags(flags)
    Screen().print(*shown, sep="\n")
    code = write_flags(flags)
    list_written(written)
    return code


def _signed(signs: Signs | None, recordings: Sequence[Recording], robot: Robot) -> dict[str, Content]:
    """A table per recording whose signs were recovered (signed.csv, signed_2.csv, ...), and a page about the signs."""
    from ..output.report import signed_csv, signs_page

    if signs is None:
        return {}
    part = {trace.path: k for k, trace in enumerate(signs.traces)}
    found = [recording for recording in recordings if recording.path in part]
    tables = [signed_csv(recording, signs, part[recording.path]) for recording in found]
    names = ["signed.csv", *(f"signed_{k + 2}.csv" for k in range(len(tables) - 1))]
    units = ["N" if prismatic else "N.m" for prismatic in robot.prismatic]
    return {**dict(zip(names, tables, strict=True)), "signs.html": signs_page(signs, units)}


def _urdf(robot: Robot, bodies: Array, laws: Sequence[Law]) -> tuple[dict[str, Content], tuple[str, ...]]:
    """The robot's URDF with the identified parameters; if it cannot be written, a note with the reason."""
    from ..output.export import urdf_with

    if robot.kind != "urdf":
        why = f"the robot comes from {robot.kind.upper()}"
    else:
        try:
            return {"robot.urdf": urdf_with(robot, bodies, *(_friction(robot, laws, name) for name in FRICTION))}, ()
        except RobotError as error:
            why = str(error)
    return {}, (f"robot.urdf is not written: {why}",)


def _extended_urdf(result: Diagnosis) -> tuple[dict[str, Content], tuple[str, ...]]:
    """The URDF of the extended simulation, and notes on content that it cannot hold."""
    from ..output.export import export

    try:
        made = export(result.model, "urdf")
    except RobotError as error:
        return {}, (f"robot.urdf is not written: {error}",)
    return {"robot.urdf": made.text}, tuple(f"robot.urdf: {note}" for note in made.notes)


def _identifiable_bodies(result: Identification) -> Array:
    """(nb, 10) inertial parameters [kg, kg.m, kg.m2]; NaN for bodies without effect on torque."""
    bodies = result.parameters.bodies().copy()
    shown = np.any(result.base.combination != 0, axis=0)
    for body in range(len(bodies)):
        if not any(s for s, label in zip(shown, result.base.labels, strict=True) if label.body == body):
            bodies[body] = np.nan
    return bodies


def _friction(robot: Robot, laws: Sequence[Law], effect: str) -> Array:
    """Coefficient of a law per joint, (n,) [N.m.s/rad or N.m]; NaN at joints without it, zero if negative."""
    values = np.full(len(robot.joints), np.nan)
    for law in laws:
        if law.effect.name == effect:
            values[list(law.joints)] = max(0.0, *law.parameters.values())
    return values
