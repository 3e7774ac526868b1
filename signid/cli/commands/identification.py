"""The commands `inspect`, `check`, `identify` and `payload`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...deadline import DEFAULT_TIME_LIMIT, time_limit
from ...errors import InputError, OptionError, RecordingError, readable
from ..app import (
    DriveOptions,
    Effects,
    OptionalRecordings,
    Recordings,
    RobotArguments,
    RowOptions,
    RunOptions,
    SimulationArguments,
    Text,
    Texts,
    TimeLimit,
    Unsigned,
    command,
    option,
    output_option,
)
from ..arguments import (
    check_options,
    given_command,
    given_effects,
    given_inputs,
    given_model,
    given_options,
    given_recordings,
    given_robot,
    has_drives,
    instead_of_torque,
    simulation_inputs,
    under_gravity,
)
from ..terminal import bars, check_folder, check_unread, show

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ...check import Check
    from ...estimation.standard import Search
    from ...faults import ServoAudit, UnusableRecordings


@command("signid inspect panda --joints panda_joint6,panda_joint7")
def inspect(robot: RobotArguments, run: RunOptions, effects: Effects = None) -> int:
    """List joints, links, base and unidentifiable parameters."""
    from ...check import inspect as look
    from ...output.report import document, tables, to_json

    described = given_robot(robot.robot, robot)
    inspection = look(described, given_effects(effects), run.seed)
    content = document(inspection, given_inputs(robot.robot, described, robot.actuators), seed=run.seed)
    return show(to_json(content) if run.json else tables(inspection), inspection.flags)


@command("signid check 3r recording.csv")
def check(
    context: typer.Context,
    robot: RobotArguments,
    rows: RowOptions,
    run: RunOptions,
    *,
    recordings: OptionalRecordings = None,
    unsigned: Unsigned = False,
    output: Annotated[
        Text, typer.Option("--output", "-o", metavar="DIR", help="Folder of check.json and report.html. Default: none.")
    ] = None,
) -> int:
    """Check what recordings can identify, before a model is fitted.

    On one screen: whether the recordings are good for identification, sampling and clock, units, gravity, faults, noise
    and cut-off of each joint, and what to record next. DIR gets check.json and report.html. Lost torque signs
    (abs_tau_J, abs_current_J or --unsigned) are recovered first, as in identify. Recordings of servos (q_J and q_des_J,
    no torque) are audited: lag, droop, saturation and faults of the log; a description is not needed then, signid check
    RECORDING. A file that can be opened is never refused: what is wrong with it is the verdict.

    Raises:
        OptionError: no recording was given.
    """
    from numpy.linalg import LinAlgError

    from ...check import check as judge, unusable
    from ...faults import ServoAudit
    from ...recording import is_recording, read_bare
    from ...recording.source import digest_of
    from ...types import Input
    from ..terminal import CHECK_FILES, deliver_report

    check_folder(output, True, CHECK_FILES)
    bare = is_recording(robot.robot)
    paths = [robot.robot, *(recordings or ())] if bare else recordings or []
    if not paths:
        raise OptionError(f"no recording was given; write signid check {robot.robot} RECORDING")
    described = None if bare else given_robot(robot.robot, under_gravity(robot, paths, rows.columns))
    result: Check | ServoAudit | UnusableRecordings
    try:
        if described is None:
            from ...faults.commands import audit_servos

            bares = [read_bare(path, columns=rows.columns, rate=rows.rate) for path in paths]
            units = {joint: unit for _, stated in bares for joint, unit in stated.items()}
            result = audit_servos([recording for recording, _ in bares], units)
        else:
            read = given_recordings(paths, described, rows.columns, unsigned, rows.rate, output=output, quiet=run.json)
            with bars(run.json) as progress:
                result = judge(described, read, options=given_options(rows, run.seed), progress=progress)
            if isinstance(result, ServoAudit) and not has_drives(read):  # options for torque exclude it
                instead_of_torque(context, RecordingError(result.notes[0].partition(": ")[2]), read, "checked")
    except (RecordingError, LinAlgError, ArithmeticError) as error:
        result = unusable(paths, error, rows.columns)
    if described is not None:
        inputs = given_inputs(robot.robot, described, robot.actuators, columns=rows.columns)
    else:
        inputs = [Input(readable(rows.columns), digest_of(Path(rows.columns)), "columns")] if rows.columns else []
    named = {} if hasattr(result, "robot") else {"robot": described.name if described else ""}
    return deliver_report(result, inputs, output, run.json, given_command(context), seed=run.seed, **named)


@dataclass(frozen=True, kw_only=True)
class IdentifyOptions:
    """Method, data and output of an identification."""

    output: Text = output_option("Output folder. Needed, unless --json.")
    held_out: Texts = option(None, "Held-out recording. Repeatable. Default: see above.", metavar="RECORDING")
    method: Text = option(
        None, "convex (physically consistent; default), wls, or pbrp (default with --signs tree).", metavar="HOW"
    )
    estimator: Text = option(
        None, "wls, iv, tls or oe. Default: wls, with q_des_J as instruments if recorded.", metavar="HOW"
    )
    robust: bool = option(False, "Down-weight outliers.", "--robust")
    unsigned: Unsigned = False
    signs: str = option("exact", "Recovery of lost signs: exact, or tree (sequential heuristic).", metavar="HOW")
    bounds: Texts = option(
        None,
        "TOML of parameter bounds for pbrp. Default: around ROBOT's values. Servo mode: bounds of a number of a drive, "
        "NAME=LOW..HIGH or NAME@PATTERN=LOW..HIGH. Repeatable.",
        metavar="FILE",
    )
    global_algorithm: str = option("GN_CRS2_LM", "Global NLopt algorithm for pbrp.", metavar="NAME")
    local_algorithm: str = option("LD_LBFGS", "Local NLopt algorithm for pbrp.", metavar="NAME")
    refit: bool | None = option(
        None, "Fit the written model again to all rows. Default: unless --held-out is given.", "--refit/--no-refit"
    )
    refine: Text = option(
        None,
        "Refine model.json by roll-outs: rollout; all or A,B: also choose laws (one joint). Default: no.",
        metavar="HOW",
    )
    total_mass: Text = option(None, "Range of the total mass [kg], for pbrp. Default: any.", metavar="LO,HI")
    time_limit: TimeLimit = DEFAULT_TIME_LIMIT


SHARED_OPTIONS = "output held_out columns effects method unsigned joints servo known json".split()


@command("signid identify 3r recording.csv -o result", *SHARED_OPTIONS)
def identify(
    context: typer.Context,
    fit: IdentifyOptions,
    robot: RobotArguments,
    recordings: Recordings,
    *,
    rows: RowOptions,
    drives: DriveOptions,
    run: RunOptions,
) -> int:
    """Identify a dynamics model with intervals from recordings.

    DIR gets identification.json, model.json, robot.urdf and report.html. Without --held-out the last of several
    recordings, or the last 30 % of a single one, is held out. Lost torque signs (abs_tau_J, abs_current_J or
    --unsigned) are recovered first and written to signed.csv and signs.html.

    Recordings with commanded positions (q_des_J) and without torque give the position drives instead: kp, damping,
    delay, friction, armature and limits, by simulation of the closed loop (servo mode).
    """
    from ...identify import identify as learn
    from ..terminal import IDENTIFICATION_FILES, deliver_identification
    from .drives import identify_drives, revised_columns

    check_folder(fit.output, run.json, IDENTIFICATION_FILES)
    described = given_robot(robot.robot, under_gravity(robot, recordings, rows.columns))
    given, held_out = (
        given_recordings(paths, described, rows.columns, fit.unsigned, rows.rate, output=fit.output, quiet=run.json)
        for paths in (recordings, fit.held_out)
    )
    servo = has_drives((*given, *held_out), drives.servo)
    check_options(context, servo)
    read = given_inputs(
        robot.robot, described, robot.actuators, columns=rows.columns, bounds=None if servo else _bounds(fit)
    )
    command = given_command(context)

    def through_drives(notes: Sequence[str] = ()) -> int:
        with time_limit(fit.time_limit):
            found = identify_drives(described, given, held_out, drives, run, bounds=fit.bounds, refit=fit.refit)
            more, revised = revised_columns(found, (*given, *held_out), rows.columns, fit.output)
            found = replace(found, notes=(*notes, *found.notes, *revised))
            return deliver_identification(found, read, fit.output, run.json, command, more)

    if servo:
        return through_drives()
    options, search = given_options(rows, run.seed, fit.robust), _search(fit)
    refine: tuple[str, ...] | None = None
    if fit.refine is not None:
        from ...simulation.refine import LAWS

        named = tuple(name.strip() for name in fit.refine.split(","))
        refine = () if fit.refine == "rollout" else LAWS if fit.refine == "all" else named
    with time_limit(fit.time_limit):
        try:
            with bars(run.json) as progress:
                result = learn(
                    described,
                    given,
                    held_out=held_out,
                    method=fit.method,
                    signs=fit.signs,
                    estimator=fit.estimator,
                    search=search,
                    options=options,
                    refit=fit.refit,
                    refine=refine,
                    progress=progress,
                )
        except InputError as error:
            return through_drives(instead_of_torque(context, error, (*given, *held_out), "identified"))
        return deliver_identification(result, read, fit.output, run.json, command)


def _bounds(fit: IdentifyOptions) -> str | None:
    """File of bounds for penalty-based parameter retrieval."""
    texts = fit.bounds or []
    if len(texts) > 1 or any("=" in text and not Path(text).exists() for text in texts):
        raise OptionError(
            f"--bounds {texts[0]!r} applies to position drives, and the recordings have torque; give one TOML file, or "
            f"add --servo"
        )
    return texts[0] if texts else None


def _search(fit: IdentifyOptions) -> Search:
    """Options of penalty-based parameter retrieval."""
    from ...estimation.standard import Search

    total = None
    if fit.total_mass is not None:
        try:
            low, high = (float(part) for part in fit.total_mass.split(","))
        except ValueError:
            low, high = 1.0, 0.0
        if not 0 <= low <= high:
            raise OptionError(f"--total-mass {fit.total_mass!r} is not a range; write LO,HI in kg with LO <= HI")
        total = (low, high)
    return Search(_bounds(fit), fit.global_algorithm, fit.local_algorithm, total)


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
    from ..terminal import PAYLOAD_FILES, deliver

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
        result = identify_payload(model, *sides, options=options, progress=progress)
    inputs = simulation_inputs(simulation, model.robot, columns=rows.columns)
    files = {"model.json": to_json(result.model.document())} if result.found else {}
    return deliver(result, inputs, loads.output, run.json, files)
