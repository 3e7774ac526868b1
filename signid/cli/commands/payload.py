"""The command `payload`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from ...deadline import USUAL, time_limit
from ..app import app
from ..arguments import given_inputs, given_options, given_recordings, given_robot
from ..options import RobotArguments, RowOptions, RunOptions, Texts, TimeLimit, expanded
from ..terminal import bars, write_flags


@dataclass(frozen=True, kw_only=True)
class PayloadOptions:
    """Recordings of a payload identification."""

    without: Annotated[
        Texts, typer.Option(metavar="RECORDING", help="Recording without the load. Needed. Repeatable.")
    ] = None
    carrying: Annotated[
        Texts, typer.Option("--with", metavar="RECORDING", help="Recording with the load. Needed. Repeatable.")
    ] = None
    time_limit: TimeLimit = USUAL


@app.command(epilog="Example: signid payload 3r --without recording.csv --with loaded.csv")
@expanded
def payload(loads: PayloadOptions, robot: RobotArguments, rows: RowOptions, run: RunOptions) -> int:
    """Identify mass, centre of mass and inertia of a payload.

    The load is estimated from the difference between recordings with and without it, so that errors of the robot model
    cancel. Friction may change slightly between the recordings. The inertia of the load is physically consistent.
    Errors of torque constants scale the load.
    """
    from ...output.report import Screen, payload_document, payload_tables, to_json
    from ...payload import payload as identify_payload

    described = given_robot(robot.robot, robot)
    sides = [given_recordings(paths, described, rows.columns) for paths in (loads.without, loads.carrying)]
    options = given_options(rows, run.seed)
    with time_limit(loads.time_limit), bars(run.json) as progress:
        found = identify_payload(described, *sides, options=options, progress=progress)
    if run.json:
        inputs = given_inputs(robot.robot, described, robot.actuators, columns=rows.columns)
        Screen().write(to_json(payload_document(found, inputs)))
    else:
        Screen().print(*payload_tables(found), sep="\n")
    return write_flags(found.flags)
