"""The command `payload`."""

from __future__ import annotations

from dataclasses import dataclass

from ...deadline import USUAL, time_limit
from ...errors import OptionError
from ..app import Texts, command, option
from ..arguments import given_inputs, given_options, given_recordings, given_robot
from ..options import OptionalRecordings, RobotArguments, RowOptions, RunOptions, TimeLimit
from ..terminal import bars, show


@dataclass(frozen=True, kw_only=True)
class PayloadOptions:
    """Recordings of a payload identification."""

    without: Texts = option(None, "Recording without the load. Repeatable.", metavar="RECORDING")
    carrying: Texts = option(None, "Recording with the load. Repeatable.", "--with", metavar="RECORDING")
    time_limit: TimeLimit = USUAL


@command("signid payload 3r --without recording.csv --with loaded.csv")
def payload(
    loads: PayloadOptions,
    robot: RobotArguments,
    rows: RowOptions,
    run: RunOptions,
    recordings: OptionalRecordings = None,
) -> int:
    """Identify mass, centre of mass and inertia of a payload.

    The load is estimated from the difference between recordings with and without it, so that errors of the robot model
    cancel. Friction may change slightly between the recordings. The inertia of the load is physically consistent.
    Errors of torque constants scale the load.

    With one RECORDING in which the load is picked up, put down or both, the moments are found first. If no load is
    picked up, the command says so and ends with 3.
    """
    from ...output.report import document, tables, to_json
    from ...payload import payload as identify_payload

    _check_payload(loads, recordings)
    described = given_robot(robot.robot, robot)
    names = [recordings] if recordings else [loads.without, loads.carrying]
    sides = [given_recordings(paths, described, rows.columns) for paths in names]
    options = given_options(rows, run.seed)
    with time_limit(loads.time_limit), bars(run.json) as progress:
        found = identify_payload(described, *sides, options=options, progress=progress)
    if not run.json:
        return show(tables(found), found.flags)
    inputs = given_inputs(robot.robot, described, robot.actuators, columns=rows.columns)
    return show(to_json(document(found, inputs)), found.flags)


def _check_payload(loads: PayloadOptions, recordings: Texts) -> None:
    apart = bool(loads.without or loads.carrying)
    if recordings and apart:
        raise OptionError(
            "a RECORDING with a load that is picked up needs neither --without nor --with; leave them out"
        )
    if not recordings and not apart:
        raise OptionError(
            "no recording was given; give one in which the load is picked up, or --without RECORDING --with RECORDING"
        )
