"""The command `simulate`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..app import app
from ..arguments import Actuators, Joints, Json, Lock, PackageDir, Seed, SimulationName
from ..drive import Loop, given_drive
from ..output import check_file, write_columns
from ..source import Source, given_model
from ..terminal import DONE, bars

if TYPE_CHECKING:
    from ...model import Model
    from ...output.report import Run
    from ...simulation.plant import Sensors
    from ...simulation.plant.control import Drive

Output = Annotated[
    str | None,
    typer.Option(
        "--output", "-o", metavar="FILE", help="The recording: .csv, .csv.gz, .parquet or .npz. Needed, unless --json."
    ),
]
Injected = Annotated[
    list[str] | None,
    typer.Option(
        "--inject",
        metavar="LAW",
        help="EFFECT[@JOINT][:key=value,...], added to the laws of SIMULATION; the controller does not know it. "
        "Without numbers usual ones are meant. Repeatable; signid effects lists them.",
    ),
]
Number = float | None


@app.command(epilog="Example: signid simulate 3r --inject coulomb_friction@2 -o recording.csv")
def simulate(
    simulation: SimulationName,
    output: Output = None,
    motion: Annotated[
        str | None, typer.Option(metavar="FILE", help="t, q_J (dq_J, ddq_J). Default: at random.")
    ] = None,
    torque: Annotated[str | None, typer.Option(metavar="RECORDING", help="Play its torque back, open loop.")] = None,
    inject: Injected = None,
    duration: Annotated[Number, typer.Option(metavar="S", help="[s] Default: that of what drives it, or 20.")] = None,
    step: Annotated[float, typer.Option(metavar="S", help="Of controller and dynamics [s].")] = 1e-3,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Of the recording [Hz].")] = 250.0,
    integrator: Annotated[str, typer.Option(metavar="HOW", help="semi-implicit or rk4.")] = "semi-implicit",
    substeps: Annotated[int, typer.Option(metavar="N", min=0, help="In each step; 0: as the stiffest law asks.")] = 0,
    bandwidth: Annotated[Number, typer.Option(metavar="HZ", help="Of the position loop [Hz]. Default: 6.")] = None,
    kp: Annotated[str | None, typer.Option(metavar="A,B", help="Stiffness of the loop [N.m/rad]; with --kd.")] = None,
    kd: Annotated[str | None, typer.Option(metavar="A,B", help="Damping of the loop [N.m.s/rad]; with --kp.")] = None,
    feed_forward: Annotated[Number, typer.Option(metavar="SHARE", help="Of the bodies' torque. Default: 1.")] = None,
    encoder_bits: Annotated[
        Number, typer.Option(metavar="N", help="2**N counts a turn, or metre. Default: exact.")
    ] = None,
    noise: Annotated[float, typer.Option(metavar="SHARE", help="White noise of torque, over its rms.")] = 0.0,
    coloured_noise: Annotated[float, typer.Option(metavar="SHARE", help="The same, below 3 Hz.")] = 0.0,
    jitter: Annotated[float, typer.Option(metavar="SHARE", help="Of the sampling period.")] = 0.0,
    drop_outs: Annotated[float, typer.Option(metavar="SHARE", help="Of the rows, in bursts.")] = 0.0,
    unsigned: Annotated[bool, typer.Option("--unsigned", help="Record torque without its sign.")] = False,
    joints: Joints = None,
    lock: Lock = None,
    actuators: Actuators = None,
    package_dir: PackageDir = None,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """A recording of a simulated robot, with laws injected.

    The robot is controlled along --motion by position and velocity, with the torque of the bodies that SIMULATION
    states ahead. Without --motion it moves at random within its limits, from rest to rest. Joints that the motion has
    no column of are held.
    """
    from ...output.report import Screen, simulation_document, simulation_tables, to_json
    from ...simulation.plant import Sensors

    check_file(output, json)
    source = Source(simulation, joints, lock, actuators, package_dir)
    sensors = Sensors(rate, encoder_bits, noise, coloured_noise, jitter, drop_outs, unsigned)
    sensors.every(step)
    known, asked = given_model(source, motion, torque)
    drive, seconds = given_drive(known, asked, Loop(bandwidth, kp, kd, feed_forward), duration, step, seed)
    options = {"step": step, "integrator": integrator, "substeps": substeps}
    with bars(json) as progress:
        run = _run(known, inject or (), drive, seconds, sensors, seed, {**options, "progress": progress})
    document = to_json(simulation_document(run, source.inputs(known.robot, motion=motion, torque=torque), seed))
    written, screen = write_columns(output, run.columns), Screen()
    if json:
        screen.write(document)
    else:
        screen.print(*simulation_tables(run), sep="\n")
        screen.write("\n".join(["", "written:", *(f"  {path}" for path in written), ""]))
    return DONE


def _run(
    known: Model,
    inject: Sequence[str],
    drive: Drive,
    seconds: float,
    sensors: Sensors,
    seed: int,
    options: dict[str, Any],
) -> Run:
    """The known model with what is injected, moved and recorded."""
    from ...effects.naming import parse_law
    from ...errors import OptionError
    from ...model import Model
    from ...output.report import Run
    from ...simulation.plant import Torques, record, simulate

    if sensors.rate and options["step"] <= seconds <= 1 / sensors.rate:
        raise OptionError(
            f"{seconds:g} s at {sensors.rate:g} Hz are a single row; give a longer duration or more --rate"
        )
    injected = tuple(parse_law(text, known.robot) for text in inject)
    model = Model(known.robot, known.inertials, (*known.laws, *injected))
    moved = simulate(model, drive, seconds, **options)
    columns = record(known.robot, moved, sensors, desired=not isinstance(drive, Torques), seed=seed)
    return Run(model, injected, moved, columns, sensors, drive, options["integrator"])
