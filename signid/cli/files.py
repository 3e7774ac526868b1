"""Output of an identification, a diagnosis or a validation: files in a folder and text on the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ..errors import OptionError, RobotError
from .terminal import show, write_columns

if TYPE_CHECKING:
    from ..check import Check
    from ..diagnose import Diagnosis
    from ..faults import ServoAudit, UnusableRecordings
    from ..identify import Identification
    from ..model import Model
    from ..output.report import Content
    from ..output.viewers import ViewerLog
    from ..servo.diagnose import ServoDiagnosis
    from ..servo.identify import ServoIdentification
    from ..servo.validate import ServoValidation
    from ..signs import Signs
    from ..types import Array, Input, Recording, Robot
    from ..validate import Validation

Logs: TypeAlias = "tuple[ViewerLog, Mapping[str, Path]] | None"
VALIDATION_FILES = ("validation.json", "report.html")
PAYLOAD_FILES = ("payload.json", "model.json")
CHECK_FILES = ("check.json", "report.html")
DIAGNOSIS_FILES = ("diagnosis.json", "model.json", "robot.urdf", "report.html", "signed.csv", "signs.html")
IDENTIFICATION_FILES = ("identification.json", *DIAGNOSIS_FILES[1:])


def deliver(
    result: Any,
    inputs: Sequence[Input],
    output: str | None,
    json: bool,
    files: Mapping[str, Content] = MappingProxyType({}),
    *,
    logs: Logs = None,
    columns: Mapping[str, Array] | None = None,
    **given: Any,
) -> int:
    """Write and print a result; return the exit code: NAME.json and files into a folder, or columns into a file.

    `logs`: log for viewers, and its paths by kind. `given`: as of `document`; tables do without the seed.
    columns: (N,) each, by name [units of the columns of these names].
    """
    from ..output.report import document, tables, to_json, write_files

    content = document(result, inputs, **given)
    text, name = to_json(content), content["schema"].removeprefix("signid.").removesuffix("/1")
    if columns is not None or output is None:
        written = [*write_columns(output, columns or {})]
    else:
        written = write_files(output, {f"{name}.json": text, **files})
    written += write_logs(*logs) if logs else []
    given.pop("seed", None)
    return show(text if json else tables(result, **given), getattr(result, "flags", ()), written)


def deliver_identification(
    result: Identification | ServoIdentification,
    inputs: Sequence[Input],
    output: str | None,
    json: bool,
    command: str,
    more: Mapping[str, Content] = MappingProxyType({}),
) -> int:
    """Write and print an identification, with more files; return the exit code; `command` reproduces it."""
    from ..identify import Identification
    from ..output.export import with_known_numbers
    from ..output.report import page, to_json

    files: dict[str, Content] = {}
    if output is not None:
        if isinstance(result, Identification):
            model, known, left = result.best, result.best, list[str]()
            described, notes = _urdf(known, _identifiable_bodies(result))
            more = _recording_files(result.signs, result.recordings, result.robot)
        else:
            model, (known, left) = result.model, with_known_numbers(result.model, gain=False)
            described, notes = _urdf(known, known.inertials)
        unknown = "robot.urdf leaves out the numbers that are not identifiable, unless they were stated before"
        result = replace(result, notes=(*result.notes, *notes, *([unknown] if left else [])))
        shown = {**described, "report.html": page(result, inputs, command), **more}
        files = {"model.json": to_json(model.document()), **shown}
    return deliver(result, inputs, output, json, files)


def deliver_diagnosis(
    result: Diagnosis | ServoDiagnosis,
    inputs: Sequence[Input],
    output: str | None,
    json: bool,
    command: str,
    logs: Logs = None,
) -> int:
    """Write and print a diagnosis; return the exit code; `command` is the shell line that reproduces it."""
    found, files = (result, {}) if output is None else diagnosis_files(result, inputs, command)
    return deliver(found, inputs, output, json, files, logs=logs)


def diagnosis_files(
    result: Diagnosis | ServoDiagnosis, inputs: Sequence[Input], command: str
) -> tuple[Diagnosis | ServoDiagnosis, dict[str, Content]]:
    """Return the diagnosis with notes on the limits of file formats, and its files besides diagnosis.json."""
    from ..diagnose import Diagnosis
    from ..output.export import export
    from ..output.report import page, to_json

    described: dict[str, Content] = {}
    signed: dict[str, Content] = {}
    if isinstance(result, Diagnosis):
        try:
            made = export(result.model, "urdf")
            described = {"robot.urdf": _marked(made.text)}
            notes = [f"robot.urdf: {note}" for note in (*made.flags, *made.notes)]  # on content that it cannot hold
        except RobotError as error:
            notes = [f"robot.urdf is not written: {error}"]
        result = replace(result, notes=(*result.notes, *notes))
        signed = _recording_files(result.signs, result.recordings, result.robot)
    model = to_json(result.model.document())
    return result, {"model.json": model, **described, "report.html": page(result, inputs, command), **signed}


def deliver_report(
    found: Validation | ServoValidation | Check | ServoAudit | UnusableRecordings,
    inputs: Sequence[Input],
    output: str | None,
    json: bool,
    command: str,
    **given: Any,
) -> int:
    """Write and print a validation or a check; return the exit code; `given`: seed of a check, robot of an audit."""
    from ..output.report import page

    files = {} if output is None else {"report.html": page(found, inputs, command, **given)}
    return deliver(found, inputs, output, json, files, **given)


def check_logs(**files: str | None) -> dict[str, Path]:
    """Check that logs for viewers can be written; return their paths by kind, "rrd" or "mcap".

    Raises:
        OptionError: a name does not end as its kind does, or a library is missing.
        OutputError: a folder cannot be written.
    """
    asked = {kind: Path(file) for kind, file in files.items() if file is not None}
    if not asked:
        return asked
    from ..output.report import check_regular, probe_folder
    from ..output.viewers import check_library

    for kind, path in asked.items():
        if path.suffix.lower() != f".{kind}" or path.is_dir():
            raise OptionError(f"--{kind} {files[kind]!r} is not the name of a log; use a name that ends in .{kind}")
        check_library(kind)
        probe_folder(path.parent, f"--{kind}")
        check_regular(path)
    return asked


def write_logs(log: ViewerLog, paths: Mapping[str, Path]) -> list[Path]:
    """Write logs for viewers to paths by kind."""
    from ..output.report import write_files

    made = {kind: log.rrd() if kind == "rrd" else log.mcap() for kind in paths}
    return [
        written
        for kind, path in paths.items()
        for written in write_files(path.parent, {path.name: made[kind]}, f"--{kind}", named=True)
    ]


def _recording_files(signs: Signs | None, recordings: Sequence[Recording], robot: Robot) -> dict[str, Content]:
    """Readings, signed.csv (signed_2.csv, ...) of each recording with recovered signs, and a page about the signs."""
    from ..output.report.results.signs import signed_csv, signs_page
    from ..recording.source import reading_path

    read = {reading_path(each.path).name: each.reading.text for each in recordings if each.reading and each.path}
    if signs is None:
        return {**read}
    part = {trace.path: k for k, trace in enumerate(signs.traces)}
    found = [recording for recording in recordings if recording.path in part]
    tables = [signed_csv(recording, signs, part[recording.path]) for recording in found]
    names = ["signed.csv", *(f"signed_{k + 2}.csv" for k in range(len(tables) - 1))]
    units = ["N" if prismatic else "N.m" for prismatic in robot.prismatic]
    return {**dict(zip(names, tables, strict=True)), "signs.html": signs_page(signs, units), **read}


def _urdf(model: Model, bodies: Array) -> tuple[dict[str, Content], tuple[str, ...]]:
    """The robot's URDF with the identified parameters; if it cannot be written, a note with the reason."""
    from ..output.export import urdf_with
    from ..output.export.bodies import FRICTION_LAWS, summed

    if model.robot.kind != "urdf":
        why = f"the robot comes from {model.robot.kind.upper()}"
    else:
        try:
            friction = (np.maximum(summed(model, effect), 0.0) for effect in FRICTION_LAWS)
            return {"robot.urdf": _marked(urdf_with(model.robot, bodies, *friction))}, ()
        except RobotError as error:
            why = str(error)
    return {}, (f"robot.urdf is not written: {why}",)


def _marked(text: str) -> str:
    """The text of a URDF with a comment by which `write_files` recognises its own file."""
    from ..output.export import with_comment
    from ..output.report import WRITTEN

    return text if WRITTEN in text else with_comment(text, [WRITTEN])


def _identifiable_bodies(result: Identification) -> Array:
    """(nb, 10) inertial parameters [kg, kg.m, kg.m2]; NaN for bodies without effect on torque."""
    bodies = (result.parameters.bodies() if result.refined is None else result.refined.inertials).copy()
    shown = np.any(result.base.combination != 0, axis=0)
    seen = {label.body for s, label in zip(shown, result.base.labels, strict=True) if s}
    bodies[[body not in seen for body in range(len(bodies))]] = np.nan
    return bodies
