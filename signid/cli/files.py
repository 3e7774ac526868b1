"""What an identification leaves: files in a folder, and what the terminal shows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..errors import RobotError
from .show import tell_flags

if TYPE_CHECKING:
    from ..identify import Identification
    from ..types import Array


def deliver(result: Identification, inputs: Sequence[tuple[str, str]], output: str | None, json: bool) -> int:
    """Writes the files, prints the tables or the document, and tells the exit code.

    Args:
        result: the identification.
        inputs: path and sha256 of what was read besides the recordings.
        output: folder of the files, if any.
        json: whether the document is printed instead of the tables.
    """
    from ..report import Screen, identification_document, identification_tables, to_json, write_files

    files: dict[str, str | Iterator[str]] = {}
    if output is not None:
        result, described = with_urdf(result)
        files = {**described, **signed_files(result)}
    document = to_json(identification_document(result, inputs))
    files = {"identification.json": document, "model.json": to_json(result.model.document()), **files}
    written = [] if output is None else write_files(output, files)
    screen = Screen()
    if json:
        screen.write(document)
    else:
        screen.print(*identification_tables(result), sep="\n")
    code = tell_flags(result.flags)
    if written and not json:
        screen.write("\n".join(["", "written:", *(f"  {path}" for path in written), ""]))
    return code


def signed_files(result: Identification) -> dict[str, str | Iterator[str]]:
    """A table for each recording of which signs were found (signed.csv, signed_2.csv, ...), and a page of them."""
    from ..report import signed_csv, signs_page

    if result.signs is None:
        return {}
    part = {trace.path: k for k, trace in enumerate(result.signs.traces)}
    found = [recording for recording in result.recordings if recording.path in part]
    tables = [signed_csv(recording, result.signs, part[recording.path]) for recording in found]
    names = ["signed.csv", *(f"signed_{k + 2}.csv" for k in range(len(tables) - 1))]
    units = ["N" if prismatic else "N.m" for prismatic in result.robot.prismatic]
    return {**dict(zip(names, tables, strict=True)), "signs.html": signs_page(result.signs, units)}


def with_urdf(result: Identification) -> tuple[Identification, dict[str, str]]:
    """The robot's URDF with what was identified, as a file; where there is none, the result's notes say why."""
    from ..export import urdf_with

    robot = result.robot
    if robot.kind != "urdf":
        why = f"the robot comes from {robot.kind.upper()}"
    else:
        try:
            friction = (_friction(result, name) for name in ("viscous_friction", "coulomb_friction"))
            return result, {"robot.urdf": urdf_with(robot, _told_bodies(result), *friction)}
        except RobotError as error:
            why = str(error)
    return replace(result, notes=(*result.notes, f"robot.urdf is not written: {why}")), {}


def _told_bodies(result: Identification) -> Array:
    """(nb, 10) inertial parameters [kg, kg.m, kg.m2]; NaN for bodies that torque does not show."""
    bodies = result.parameters.bodies().copy()
    shown = np.any(result.base.combination != 0, axis=0)
    for body in range(len(bodies)):
        if not any(s for s, label in zip(shown, result.base.labels, strict=True) if label.body == body):
            bodies[body] = np.nan
    return bodies


def _friction(result: Identification, effect: str) -> Array:
    """(n,) the coefficient of a law [N.m.s/rad or N.m], NaN at joints without it; none less than nothing."""
    values = np.full(len(result.robot.joints), np.nan)
    for law in result.model.laws:
        if law.effect.name == effect:
            values[list(law.joints)] = max(0.0, *law.parameters.values())
    return values
