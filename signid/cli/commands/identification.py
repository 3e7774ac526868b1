"""The commands."""

from __future__ import annotations

from typing import Annotated

import typer

from ...deadline import USUAL, time_limit as limited
from ..app import app
from ..arguments import (
    Actuators,
    Bounds,
    Columns,
    Cutoff,
    Derivatives,
    Effects,
    EstimatorName,
    Files,
    GlobalAlgorithm,
    Joints,
    Json,
    LocalAlgorithm,
    Lock,
    NoInstruments,
    PackageDir,
    RobotName,
    Seed,
    SignSearch,
    TimeLimit,
    TotalMass,
    Unsigned,
    White,
    again,
    given_effects,
    given_inputs,
    given_options,
    given_recording,
    given_robot,
    given_search,
)
from ..output import check_folder
from ..terminal import DONE, bars, tell_flags


@app.command(epilog="Example: signid inspect panda --joints panda_joint6,panda_joint7")
def inspect(
    robot: RobotName,
    joints: Joints = None,
    lock: Lock = None,
    actuators: Actuators = None,
    package_dir: PackageDir = None,
    effects: Effects = None,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """Joints, links, base parameters, and what no motion can tell."""
    from ...inspect import inspect as look
    from ...output.report import Screen, inspection_document, inspection_tables, to_json

    described = given_robot(robot, joints, lock, actuators, package_dir)
    found = look(described, given_effects(effects), seed)
    if json:
        Screen().write(to_json(inspection_document(found, given_inputs(robot, described, actuators), seed)))
    else:
        Screen().print(*inspection_tables(found), sep="\n")
    return DONE


@app.command(epilog="Example: signid check 3r recording.csv")
def check(
    robot: RobotName,
    recordings: Files,
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
    unsigned: Unsigned = False,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """What recordings can tell, before a model is fitted.

    Sampling, gaps, noise, cut-offs, gross faults and excitation, and what would help. Torques without a sign
    (abs_tau_J, abs_current_J or --unsigned) get it back first, as in identify.
    """
    from ...check import check as judge
    from ...output.report import Screen, check_document, check_tables, to_json

    described = given_robot(robot, joints, lock, actuators, package_dir)
    given = [given_recording(path, described, columns, unsigned) for path in recordings]
    options = given_options(effects, cutoff, derivatives, no_instruments, white, seed)
    with bars(json) as progress:
        found = judge(described, given, options=options, progress=progress)
    if json:
        Screen().write(to_json(check_document(found, given_inputs(robot, described, actuators, columns=columns), seed)))
    else:
        Screen().print(*check_tables(found), sep="\n")
    return tell_flags(found.flags)


@app.command(epilog="Example: signid identify 3r recording.csv -o result")
def identify(
    context: typer.Context,
    robot: RobotName,
    recordings: Files,
    output: Annotated[
        str | None, typer.Option("--output", "-o", metavar="DIR", help="Folder of the results. Needed, unless --json.")
    ] = None,
    held_out: Annotated[
        list[str] | None, typer.Option(metavar="RECORDING", help="To judge by. Repeatable. Default: see above.")
    ] = None,
    joints: Joints = None,
    lock: Lock = None,
    actuators: Actuators = None,
    package_dir: PackageDir = None,
    columns: Columns = None,
    effects: Effects = None,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="HOW", help="convex (possible inertials; default), wls, or pbrp (default with --signs tree)."
        ),
    ] = None,
    estimator: EstimatorName = None,
    cutoff: Cutoff = None,
    derivatives: Derivatives = "auto",
    robust: Annotated[bool, typer.Option("--robust", help="Let outliers count less.")] = False,
    no_instruments: NoInstruments = False,
    white: White = False,
    unsigned: Unsigned = False,
    signs: SignSearch = "exact",
    bounds: Bounds = None,
    global_algorithm: GlobalAlgorithm = "GN_CRS2_LM",
    local_algorithm: LocalAlgorithm = "LD_LBFGS",
    total_mass: TotalMass = None,
    time_limit: TimeLimit = USUAL,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """A dynamics model, with intervals, from recordings.

    DIR gets identification.json, model.json, robot.urdf and report.html. Without --held-out the last of several
    recordings, or the last 30 % of the only one, is held out. Torques without a sign (abs_tau_J, abs_current_J or
    --unsigned) get it back first: signed.csv and signs.html show it. Files that signid reduce wrote may stand for the
    recordings; those of several recordings are added.
    """
    from ...identify import identify as learn
    from ..files import deliver
    from .factors import factor_inputs, given_factors

    check_folder(output, json)
    described = given_robot(robot, joints, lock, actuators, package_dir)
    given = given_factors(recordings, described, context) or [
        given_recording(path, described, columns, unsigned) for path in recordings
    ]
    judges = [given_recording(path, described, columns, unsigned) for path in held_out or ()]
    options = given_options(effects, cutoff, derivatives, no_instruments, white, seed, robust)
    search = given_search(bounds, global_algorithm, local_algorithm, total_mass)
    with limited(time_limit):
        with bars(json) as progress:
            result = learn(
                described,
                given,
                held_out=judges,
                method=method,
                signs=signs,
                estimator=estimator,
                search=search,
                options=options,
                progress=progress,
            )
        read = given_inputs(robot, described, actuators, columns=columns, bounds=bounds)
        read += factor_inputs(recordings)
        return deliver(result, read, output, json, again(context))
