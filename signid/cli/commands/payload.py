"""The command `payload`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...deadline import DEFAULT_TIME_LIMIT, time_limit
from ...errors import OptionError
from ..app import Text, Texts, command, option, output_option
from ..arguments import given_model, given_options, given_recordings, given_robot, simulation_inputs, under_gravity
from ..options import OptionalRecordings, RowOptions, RunOptions, SimulationArguments, TimeLimit
from ..terminal import bars, check_folder, check_unread


@dataclass(frozen=True, kw_only=True)
class PayloadOptions:
    """Recordings of a payload identification."""

    without: Texts = option(None, "Recording without the load. Repeatable.", metavar="RECORDING")
    carrying: Texts = option(None, "Recording with the load. Repeatable.", "--with", metavar="RECORDING")
    time_limit: TimeLimit = DEFAULT_TIME_LIMIT
    output: Text = output_option("Folder of payload.json and model.json, with the load. Default: none.")


@command("signid payload 3r --without recording.csv --with loaded.csv")
def payload(
    loads: PayloadOptions,
    simulation: SimulationArguments,
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

    DIR gets payload.json and model.json: SIMULATION with the load beside those that it carries already.

    Raises:
        OptionError: no recording was given, or one with --without or --with.
    """
    from ...model import load_model
    from ...output.report import to_json
    from ...payload import payload as identify_payload
    from ..files import PAYLOAD_FILES, deliver

    apart = bool(loads.without or loads.carrying)
    if recordings and apart:
        raise OptionError(
            "a RECORDING with a load that is picked up needs neither --without nor --with; leave them out"
        )
    if not recordings and not apart:
        raise OptionError(
            "no recording was given; give one in which the load is picked up, or --without RECORDING --with RECORDING"
        )
    check_folder(loads.output, True, PAYLOAD_FILES)
    if loads.output is not None:
        check_unread(Path(loads.output) / "model.json", [simulation.simulation])
    names = [recordings] if recordings else [loads.without, loads.carrying]
    simulation = under_gravity(simulation, names[0], rows.columns)
    described = None if simulation.saved else given_robot(simulation.simulation, simulation)
    model = load_model(described) if described else given_model(simulation)[0]
    sides = [
        given_recordings(paths, model.robot, rows.columns, rate=rows.rate, output=loads.output, quiet=run.json)
        for paths in names
    ]
    options = given_options(rows, run.seed)
    with time_limit(loads.time_limit), bars(run.json) as progress:
        found = identify_payload(model, *sides, options=options, progress=progress)
    inputs = simulation_inputs(simulation, model.robot, columns=rows.columns)
    files = {"model.json": to_json(found.model.document())} if found.found else {}
    return deliver(found, inputs, loads.output, run.json, files)
