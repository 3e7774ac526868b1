"""The command `diagnose`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from ...deadline import USUAL, time_limit as limited
from ..app import app
from ..arguments import (
    Actuators,
    Columns,
    Cutoff,
    Files,
    Joints,
    Json,
    Lock,
    PackageDir,
    Seed,
    SimulationName,
    TimeLimit,
    Unsigned,
    again,
)
from ..output import check_folder
from ..source import Source, given_model
from ..terminal import bars

if TYPE_CHECKING:
    from ...types import Recording, Robot

Paths = list[str] | None


@app.command(epilog="Example: signid diagnose 3r recording.csv -o diagnosis")
def diagnose(
    context: typer.Context,
    simulation: SimulationName,
    recordings: Files,
    output: Annotated[
        str | None, typer.Option("--output", "-o", metavar="DIR", help="Folder of the results. Needed, unless --json.")
    ] = None,
    held_out: Annotated[
        Paths, typer.Option(metavar="RECORDING", help="To judge by. Repeatable. Default: see above.")
    ] = None,
    reference: Annotated[
        Paths, typer.Option(metavar="RECORDING", help="Of the robot when all was well. Repeatable.")
    ] = None,
    skip: Annotated[Paths, typer.Option(metavar="EFFECT", help="A law that cannot be. Repeatable.")] = None,
    joints: Joints = None,
    lock: Lock = None,
    actuators: Actuators = None,
    package_dir: PackageDir = None,
    columns: Columns = None,
    cutoff: Cutoff = None,
    unsigned: Unsigned = False,
    time_limit: TimeLimit = USUAL,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """Why a simulation is wrong: which physics it lacks, and where.

    Laws are named with numbers, probability and what would explain the recordings as well. DIR gets diagnosis.json,
    report.html, and the simulation with what it lacked as model.json and robot.urdf. Without --held-out the last of
    several recordings, or the last 30 % of the only one, is held out. What the simulation lacks in --reference
    recordings, too, is no finding. Torques without a sign get it back first, as in identify.
    """
    from ...diagnose import diagnose as search
    from ...regression.session import Options
    from ..files import deliver_diagnosis

    check_folder(output, json)
    source = Source(simulation, joints, lock, actuators, package_dir)
    model, _ = given_model(source)
    given, judges, healthy = (
        _read(paths, model.robot, columns, unsigned) for paths in (recordings, held_out, reference)
    )
    options = Options(cutoff=cutoff, seed=seed)
    with limited(time_limit):
        with bars(json, one=True) as progress:
            result = search(
                model,
                given,
                held_out=judges,
                reference=healthy,
                skip=[name.strip() for text in skip or () for name in text.split(",")],
                options=options,
                progress=progress,
            )
        return deliver_diagnosis(result, source.inputs(model.robot, columns=columns), output, json, again(context))


def _read(paths: Paths, robot: Robot, columns: str | None, unsigned: bool) -> list[Recording]:
    from ..arguments import given_recording

    return [given_recording(path, robot, columns, unsigned) for path in paths or ()]
