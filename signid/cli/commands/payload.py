"""The command `payload`."""

from __future__ import annotations

from typing import Annotated

import typer

from ...deadline import USUAL, time_limit as limited
from ..app import app
from ..arguments import (
    Actuators,
    Columns,
    Cutoff,
    Derivatives,
    Effects,
    Joints,
    Json,
    Lock,
    NoInstruments,
    PackageDir,
    RobotName,
    Seed,
    TimeLimit,
    White,
    given_inputs,
    given_options,
    given_recording,
    given_robot,
)
from ..terminal import bars, tell_flags


@app.command(epilog="Example: signid payload 3r --without recording.csv --with loaded.csv")
def payload(
    robot: RobotName,
    without: Annotated[
        list[str] | None, typer.Option(metavar="RECORDING", help="Of the robot without the load. Needed. Repeatable.")
    ] = None,
    carrying: Annotated[
        list[str] | None, typer.Option("--with", metavar="RECORDING", help="With the load. Needed. Repeatable.")
    ] = None,
    joints: Joints = None,
    lock: Lock = None,
    actuators: Actuators = None,
    package_dir: PackageDir = None,
    columns: Columns = None,
    effects: Effects = None,
    cutoff: Cutoff = None,
    derivatives: Derivatives = "auto",
    no_instruments: NoInstruments = False,
    white: White = False,
    time_limit: TimeLimit = USUAL,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """Mass, centre of mass and inertia of what the last link carries.

    From recordings without the load and with it: what is the robot's own falls out of their difference, friction may
    have changed a little, and the load is a body that could exist. Errors of torque constants are errors of the load.
    """
    from ...output.report import Screen, payload_document, payload_tables, to_json
    from ...payload import payload as weigh

    described = given_robot(robot, joints, lock, actuators, package_dir)
    sides = [[given_recording(path, described, columns) for path in paths or ()] for paths in (without, carrying)]
    options = given_options(effects, cutoff, derivatives, no_instruments, white, seed)
    with limited(time_limit), bars(json) as progress:
        found = weigh(described, *sides, options=options, progress=progress)
    if json:
        inputs = given_inputs(robot, described, actuators, columns=columns)
        Screen().write(to_json(payload_document(found, inputs)))
    else:
        Screen().print(*payload_tables(found), sep="\n")
    return tell_flags(found.flags)
