"""The command `diagnose`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from ...deadline import USUAL, time_limit
from ..app import app
from ..arguments import given_command, given_model, given_recordings, simulation_inputs
from ..options import (
    Columns,
    Cutoff,
    HeldOut,
    OutputFolder,
    Recordings,
    RunOptions,
    SimulationArguments,
    Texts,
    TimeLimit,
    Unsigned,
    expanded,
)
from ..output import check_folder
from ..terminal import bars


@dataclass(frozen=True, kw_only=True)
class DiagnoseOptions:
    """Recordings, search and output of a diagnosis."""

    output: OutputFolder = None
    held_out: HeldOut = None
    reference: Annotated[
        Texts, typer.Option(metavar="RECORDING", help="Recording of the robot in a healthy state. Repeatable.")
    ] = None
    skip: Annotated[Texts, typer.Option(metavar="EFFECT", help="Effect to exclude from the search. Repeatable.")] = None
    columns: Columns = None
    cutoff: Cutoff = None
    unsigned: Unsigned = False
    time_limit: TimeLimit = USUAL


@app.command(epilog="Example: signid diagnose 3r recording.csv -o diagnosis")
@expanded
def diagnose(
    context: typer.Context,
    diagnosis: DiagnoseOptions,
    simulation: SimulationArguments,
    recordings: Recordings,
    run: RunOptions,
) -> int:
    """Find the physics that a simulation lacks, and where it acts.

    Each law is listed with its parameters, its probability and the alternatives that fit equally well. DIR gets
    diagnosis.json, report.html, and the extended simulation as model.json and robot.urdf. Without --held-out the last
    of several recordings, or the last 30 % of a single one, is held out. Differences that --reference recordings show
    as well are not reported. Lost torque signs are recovered first, as in identify.
    """
    from ...diagnose import diagnose as search
    from ...regression.session import Options
    from ..files import deliver_diagnosis

    check_folder(diagnosis.output, run.json)
    model, _ = given_model(simulation)
    given, held_out, healthy = (
        given_recordings(paths, model.robot, diagnosis.columns, diagnosis.unsigned)
        for paths in (recordings, diagnosis.held_out, diagnosis.reference)
    )
    with time_limit(diagnosis.time_limit):
        with bars(run.json, one=True) as progress:
            result = search(
                model,
                given,
                held_out=held_out,
                reference=healthy,
                skip=[name.strip() for text in diagnosis.skip or () for name in text.split(",")],
                options=Options(cutoff=diagnosis.cutoff, seed=run.seed),
                progress=progress,
            )
        inputs = simulation_inputs(simulation, model.robot, columns=diagnosis.columns)
        return deliver_diagnosis(result, inputs, diagnosis.output, run.json, given_command(context))
