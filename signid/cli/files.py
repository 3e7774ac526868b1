"""Output of an identification, a diagnosis or a validation: files in a folder and text on the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ..errors import OptionError, RobotError
from .terminal import show

if TYPE_CHECKING:
    from ..check import Check
    from ..diagnose import Diagnosis
    from ..faults import ServoAudit, UnusableRecordings
    from ..identify import Identification
    from ..model import Model
    from ..output.report import Content
    from ..output.viewers import ViewerLog
    from ..payload import Payload
    from ..servo.diagnose import ServoDiagnosis
    from ..servo.identify import ServoIdentification
    from ..servo.validate import ServoValidation
    from ..signs import Signs
    from ..types import Array, Input, Recording, Robot
    from ..validate import Validation

Logs: TypeAlias = "tuple[ViewerLog, Mapping[str, Path]] | None"
VALIDATED = ("validation.json", "report.html")
WEIGHED = ("payload.json", "model.json")
CHECKED = ("check.json", "report.html")
DIAGNOSED = ("diagnosis.json", "model.json", "robot.urdf", "report.html", "signed.csv", "signs.html")
IDENTIFIED = ("identification.json", *DIAGNOSED[1:])


def deliver(result: Identification, inputs: Sequence[Input], output: str | None, json: bool, command: str) -> int:
    """Write and print an identification; return the exit code; `command` is the shell line that reproduces it."""
    from ..output.report import document, page, tables, to_json

    files: dict[str, Content] = {}
    if output is not None:
        described, notes = _urdf(result.best, _identifiable_bodies(result))
        result = replace(result, notes=(*result.notes, *notes))
        signed = _signed(result.signs, result.recordings, result.robot) | _readings(result.recordings)
        files = {**described, "report.html": page(result, inputs, command), **signed}
    text = to_json(document(result, inputs))
    files = {"identification.json": text, "model.json": to_json(result.best.document()), **files}
    return show(text if json else tables(result), result.flags, _written(output, files))


def deliver_servos(
    result: ServoIdentification,
    inputs: Sequence[Input],
    output: str | None,
    json: bool,
    command: str,
    more: Mapping[str, Content],
) -> int:
    """Write and print an identification of position drives, with more files; return the exit code."""
    from ..output.export import with_known_numbers
    from ..output.report import document, page, tables, to_json

    files: dict[str, Content] = {}
    if output is not None:
        known, left = with_known_numbers(result.model, gain=False)
        described, notes = _urdf(known, known.inertials)
        unknown = "robot.urdf leaves out the numbers that are not identifiable, unless they were stated before"
        result = replace(result, notes=(*result.notes, *notes, *([unknown] if left else [])))
        files = {**described, "report.html": page(result, inputs, command), **more}
    text = to_json(document(result, inputs))
    files = {"identification.json": text, "model.json": to_json(result.model.document()), **files}
    return show(text if json else tables(result), result.flags, _written(output, files))


def deliver_diagnosis(
    result: Diagnosis, inputs: Sequence[Input], output: str | None, json: bool, command: str, logs: Logs = None
) -> int:
    """Write and print a diagnosis; return the exit code; `command` is the shell line that reproduces it.

    `logs`: log for viewers, and its paths by kind.
    """
    from ..output.report import document, tables, to_json

    files: dict[str, Content] = {}
    if output is not None:
        result, files = diagnosis_files(result, inputs, command)
    text = to_json(document(result, inputs))
    written = [*_written(output, {"diagnosis.json": text, **files}), *(write_logs(*logs) if logs else ())]
    return show(text if json else tables(result), result.flags, written)


def diagnosis_files(result: Diagnosis, inputs: Sequence[Input], command: str) -> tuple[Diagnosis, dict[str, Content]]:
    """Return the diagnosis with notes on the limits of file formats, and its files besides diagnosis.json."""
    from ..output.report import page, to_json

    described, notes = _extended_urdf(result)
    result = replace(result, notes=(*result.notes, *notes))
    signed = _signed(result.signs, result.recordings, result.robot) | _readings(result.recordings)
    model = to_json(result.model.document())
    return result, {"model.json": model, **described, "report.html": page(result, inputs, command), **signed}


def deliver_report(
    found: Validation | ServoValidation | Check | ServoAudit | UnusableRecordings,
    inputs: Sequence[Input],
    output: str | None,
    json: bool,
    command: str,
    *,
    seed: int | None = None,
    robot: str | None = None,
) -> int:
    """Write and print a validation or a check; return the exit code; `seed` of a check, `robot`: name, of an audit."""
    from ..output.report import document, page, tables, to_json

    named: dict[str, Any] = {} if robot is None else {"robot": robot}
    given = named if seed is None else {**named, "seed": seed}
    content = document(found, inputs, **given)
    text, name = to_json(content), content["schema"].removeprefix("signid.").removesuffix("/1")
    files = {} if output is None else {f"{name}.json": text, "report.html": page(found, inputs, command, **given)}
    return show(text if json else tables(found, **named), found.flags, _written(output, files))


def deliver_payload(found: Payload, inputs: Sequence[Input], output: str | None, json: bool) -> int:
    """Write and print a payload, and the model with it if there is one; return the exit code."""
    from ..output.report import document, tables, to_json

    text = to_json(document(found, inputs))
    files = {"payload.json": text, **({"model.json": to_json(found.model.document())} if found.found else {})}
    return show(text if json else tables(found), found.flags, _written(output, files))


def deliver_servo_diagnosis(
    result: ServoDiagnosis, inputs: Sequence[Input], output: str | None, json: bool, command: str, logs: Logs = None
) -> int:
    """Write and print a diagnosis of position drives; return the exit code; `logs` as in `deliver_diagnosis`."""
    from ..output.report import document, page, tables, to_json

    text = to_json(document(result, inputs))
    files: dict[str, Content] = {}
    if output is not None:
        shown = page(result, inputs, command)
        files = {"diagnosis.json": text, "model.json": to_json(result.model.document()), "report.html": shown}
    written = [*_written(output, files), *(write_logs(*logs) if logs else ())]
    return show(text if json else tables(result), result.flags, written)


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
    written = [
        write_files(path.parent, {path.name: made[kind]}, f"--{kind}", named=True) for kind, path in paths.items()
    ]
    return [path for each in written for path in each]


def _written(output: str | None, files: Mapping[str, Content]) -> Sequence[Path]:
    """Write files into a folder, if one was named."""
    from ..output.report import write_files

    return [] if output is None else write_files(output, files)


def _signed(signs: Signs | None, recordings: Sequence[Recording], robot: Robot) -> dict[str, Content]:
    """A table per recording whose signs were recovered (signed.csv, signed_2.csv, ...), and a page about the signs."""
    from ..output.report.results.signs import signed_csv, signs_page

    if signs is None:
        return {}
    part = {trace.path: k for k, trace in enumerate(signs.traces)}
    found = [recording for recording in recordings if recording.path in part]
    tables = [signed_csv(recording, signs, part[recording.path]) for recording in found]
    names = ["signed.csv", *(f"signed_{k + 2}.csv" for k in range(len(tables) - 1))]
    units = ["N" if prismatic else "N.m" for prismatic in robot.prismatic]
    return {**dict(zip(names, tables, strict=True)), "signs.html": signs_page(signs, units)}


def _readings(recordings: Sequence[Recording]) -> dict[str, Content]:
    """The readings of recordings, by the names of their files."""
    from ..recording.source import reading_path

    return {reading_path(each.path).name: each.reading.text for each in recordings if each.reading and each.path}


def _urdf(model: Model, bodies: Array) -> tuple[dict[str, Content], tuple[str, ...]]:
    """The robot's URDF with the identified parameters; if it cannot be written, a note with the reason."""
    from ..output.export import urdf_with
    from ..output.export.formats import FRICTION, summed

    if model.robot.kind != "urdf":
        why = f"the robot comes from {model.robot.kind.upper()}"
    else:
        try:
            friction = (np.maximum(summed(model, effect), 0.0) for effect in FRICTION)
            return {"robot.urdf": _marked(urdf_with(model.robot, bodies, *friction))}, ()
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
    return {"robot.urdf": _marked(made.text)}, tuple(f"robot.urdf: {note}" for note in (*made.flags, *made.notes))


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
