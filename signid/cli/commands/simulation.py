"""The command `simulate`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from ..app import app
from ..arguments import given_model, simulation_inputs
from ..drive import LoopOptions, given_drive
from ..options import RunOptions, SimulationArguments, Texts, expanded
from ..output import check_file, list_written, write_columns
from ..terminal import DONE, bars

if TYPE_CHECKING:
    from ...model import Model
    from ...output.report import SimulationRun
    from ...simulation.plant import Sensors, Torques
    from ...types import Trajectory


@dataclass(frozen=True, kw_only=True)
class SimulateOptions:
    """Motion, injected laws, integration and output of a simulation."""

    output: Annotated[
        str | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="The recording: .csv, .csv.gz, .parquet or .npz. Needed, unless --json.",
        ),
    ] = None
    motion: Annotated[
        str | None, typer.Option(metavar="FILE", help="Desired motion: t, q_J (dq_J, ddq_J). Default: random.")
    ] = None
    torque: Annotated[str | None, typer.Option(metavar="RECORDING", help="Play back its torque in open loop.")] = None
    inject: Annotated[
        Texts,
        typer.Option(
            "--inject",
            metavar="LAW",
            help="EFFECT[@JOINT][:key=value,...], added to the laws of SIMULATION and unknown to the controller. "
            "Omitted parameters take their usual values. Repeatable; signid effects lists them.",
        ),
    ] = None
    duration: Annotated[
        float | None, typer.Option(metavar="S", help="Duration [s]. Default: that of the motion or torque, or 20.")
    ] = None
    step: Annotated[float, typer.Option(metavar="S", help="Time step of controller and dynamics [s].")] = 1e-3
    integrator: Annotated[str, typer.Option(metavar="HOW", help="semi-implicit or rk4.")] = "semi-implicit"
    substeps: Annotated[
        int, typer.Option(metavar="N", min=0, help="Substeps per step; 0: as many as the stiffest law needs.")
    ] = 0


@dataclass(frozen=True, kw_only=True)
class SensorOptions:
    """Sensors of the simulated robot."""

    rate: Annotated[float, typer.Option(metavar="HZ", help="Sampling rate of the recording [Hz].")] = 250.0
    encoder_bits: Annotated[
        float | None, typer.Option(metavar="N", help="2**N counts per turn or metre. Default: exact.")
    ] = None
    noise: Annotated[float, typer.Option(metavar="SHARE", help="White torque noise, relative to the rms torque.")] = 0.0
    coloured_noise: Annotated[
        float, typer.Option(metavar="SHARE", help="Torque noise below 3 Hz, relative to the rms torque.")
    ] = 0.0
    jitter: Annotated[float, typer.Option(metavar="SHARE", help="Jitter, relative to the sampling period.")] = 0.0
    drop_outs: Annotated[float, typer.Option(metavar="SHARE", help="Share of rows lost, in bursts.")] = 0.0
    unsigned: Annotated[bool, typer.Option("--unsigned", help="Record torque without its sign.")] = False

    def build(self) -> Sensors:
        """Return the sensors."""
        from ...simulation.plant import Sensors

        noise = self.noise, self.coloured_noise
        return Sensors(self.rate, self.encoder_bits, *noise, self.jitter, self.drop_outs, self.unsigned)


@app.command(epilog="Example: signid simulate 3r --inject coulomb_friction@2 -o recording.csv")
@expanded
def simulate(
    plant: SimulateOptions,
    loop: LoopOptions,
    sensors: SensorOptions,
    simulation: SimulationArguments,
    run: RunOptions,
) -> int:
    """Simulate a robot with injected laws, and record it.

    A position and velocity controller follows --motion, with the rigid-body torque of SIMULATION as feed-forward.
    Without --motion the robot moves at random within its limits, from rest to rest. Joints without a column in the
    motion are held.
    """
    from ...output.report import Screen, simulation_document, simulation_tables, to_json

    check_file(plant.output, run.json)
    recorded = sensors.build()
    recorded.every(plant.step)
    known, asked = given_model(simulation, plant.motion, plant.torque)
    done = _run(known, asked, plant, loop, recorded, run)
    files = {"motion": plant.motion, "torque": plant.torque}
    document = to_json(simulation_document(done, simulation_inputs(simulation, known.robot, **files), run.seed))
    written = write_columns(plant.output, done.columns)
    if run.json:
        Screen().write(document)
    else:
        Screen().print(*simulation_tables(done), sep="\n")
        list_written(written)
    return DONE


def _run(
    known: Model,
    asked: Trajectory | Torques | None,
    plant: SimulateOptions,
    loop: LoopOptions,
    sensors: Sensors,
    run: RunOptions,
) -> SimulationRun:
    """Simulate and record the known model with the injected laws."""
    from ...effects.naming import parse_law
    from ...errors import OptionError
    from ...model import Model
    from ...output.report import SimulationRun
    from ...simulation.plant import Torques, record, simulate

    drive, seconds = given_drive(known, asked, loop, plant.duration, plant.step, run.seed)
    if sensors.rate and plant.step <= seconds <= 1 / sensors.rate:
        raise OptionError(
            f"{seconds:g} s at {sensors.rate:g} Hz are a single row; give a longer duration or a higher --rate"
        )
    injected = tuple(parse_law(text, known.robot) for text in plant.inject or ())
    model = Model(known.robot, known.inertials, (*known.laws, *injected))
    with bars(run.json) as progress:
        moved = simulate(
            model,
            drive,
            seconds,
            step=plant.step,
            integrator=plant.integrator,
            substeps=plant.substeps,
            progress=progress,
        )
    columns = record(known.robot, moved, sensors, desired=not isinstance(drive, Torques), seed=run.seed)
    return SimulationRun(model, injected, moved, columns, sensors, drive, plant.integrator)
