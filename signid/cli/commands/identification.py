"""The commands `inspect`, `check` and `identify`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from ...deadline import USUAL, time_limit
from ...errors import OptionError
from ..app import app
from ..arguments import given_command, given_effects, given_inputs, given_options, given_recordings, given_robot
from ..options import (
    Effects,
    HeldOut,
    OutputFolder,
    Recordings,
    RobotArguments,
    RowOptions,
    RunOptions,
    TimeLimit,
    Unsigned,
    expanded,
)
from ..output import check_folder
from ..terminal import DONE, bars, write_flags

if TYPE_CHECKING:
    from ...estimation.standard import Search


@app.command(epilog="Example: signid inspect panda --joints panda_joint6,panda_joint7")
@expanded
def inspect(robot: RobotArguments, run: RunOptions, effects: Effects = None) -> int:
    """List joints, links, base and unidentifiable parameters."""
    from ...inspect import inspect as look
    from ...output.report import Screen, inspection_document, inspection_tables, to_json

    described = given_robot(robot.robot, robot)
    found = look(described, given_effects(effects), run.seed)
    if run.json:
        inputs = given_inputs(robot.robot, described, robot.actuators)
        Screen().write(to_json(inspection_document(found, inputs, run.seed)))
    else:
        Screen().print(*inspection_tables(found), sep="\n")
    return DONE


@app.command(epilog="Example: signid check 3r recording.csv")
@expanded
def check(
    robot: RobotArguments, recordings: Recordings, rows: RowOptions, run: RunOptions, unsigned: Unsigned = False
) -> int:
    """Check what recordings can identify, before a model is fitted.

    Covers sampling, gaps, noise, cut-offs, recording faults and excitation, and advises what to improve. Lost torque
    signs (abs_tau_J, abs_current_J or --unsigned) are recovered first, as in identify.
    """
    from ...check import check as judge
    from ...output.report import Screen, check_document, check_tables, to_json

    described = given_robot(robot.robot, robot)
    given = given_recordings(recordings, described, rows.columns, unsigned)
    with bars(run.json) as progress:
        found = judge(described, given, options=given_options(rows, run.seed), progress=progress)
    if run.json:
        inputs = given_inputs(robot.robot, described, robot.actuators, columns=rows.columns)
        Screen().write(to_json(check_document(found, inputs, run.seed)))
    else:
        Screen().print(*check_tables(found), sep="\n")
    return write_flags(found.flags)


@dataclass(frozen=True, kw_only=True)
class IdentifyOptions:
    """Method, data and output of an identification."""

    output: OutputFolder = None
    held_out: HeldOut = None
    method: Annotated[
        str | None,
        typer.Option(
            metavar="HOW",
            help="convex (physically consistent; default), wls, or pbrp (default with --signs tree).",
        ),
    ] = None
    estimator: Annotated[
        str | None,
        typer.Option(metavar="HOW", help="wls, iv, tls or oe. Default: wls, with q_des_J as instruments if recorded."),
    ] = None
    robust: Annotated[bool, typer.Option("--robust", help="Down-weight outliers.")] = False
    unsigned: Unsigned = False
    signs: Annotated[
        str, typer.Option(metavar="HOW", help="Recovery of lost signs: exact, or tree (sequential heuristic).")
    ] = "exact"
    bounds: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="TOML of parameter bounds for pbrp. Default: around ROBOT's values."),
    ] = None
    global_algorithm: Annotated[str, typer.Option(metavar="NAME", help="Global NLopt algorithm for pbrp.")] = (
        "GN_CRS2_LM"
    )
    local_algorithm: Annotated[str, typer.Option(metavar="NAME", help="Local NLopt algorithm for pbrp.")] = "LD_LBFGS"
    total_mass: Annotated[
        str | None, typer.Option(metavar="LO,HI", help="Range of the total mass [kg], for pbrp. Default: any.")
    ] = None
    time_limit: TimeLimit = USUAL


@app.command(epilog="Example: signid identify 3r recording.csv -o result")
@expanded
def identify(
    context: typer.Context,
    fit: IdentifyOptions,
    robot: RobotArguments,
    recordings: Recordings,
    rows: RowOptions,
    run: RunOptions,
) -> int:
    """Identify a dynamics model with intervals from recordings.

    DIR gets identification.json, model.json, robot.urdf and report.html. Without --held-out the last of several
    recordings, or the last 30 % of a single one, is held out. Lost torque signs (abs_tau_J, abs_current_J or
    --unsigned) are recovered first and written to signed.csv and signs.html. Files from signid reduce can replace
    recordings; several such files are added.
    """
    from ...identify import identify as learn
    from ..files import deliver
    from .factors import factor_inputs, given_factors

    check_folder(fit.output, run.json)
    described = given_robot(robot.robot, robot)
    given = given_factors(recordings, described, context) or given_recordings(
        recordings, described, rows.columns, fit.unsigned
    )
    held_out = given_recordings(fit.held_out, described, rows.columns, fit.unsigned)
    options, search = given_options(rows, run.seed, fit.robust), _search(fit)
    with time_limit(fit.time_limit):
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
                progress=progress,
            )
        read = given_inputs(robot.robot, described, robot.actuators, columns=rows.columns, bounds=fit.bounds)
        read += factor_inputs(recordings)
        return deliver(result, read, fit.output, run.json, given_command(context))


def _search(fit: IdentifyOptions) -> Search:
    """Options of penalty-based parameter retrieval.

    Raises:
        OptionError: the range of the total mass is invalid.
    """
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
    return Search(fit.bounds, fit.global_algorithm, fit.local_algorithm, total)
