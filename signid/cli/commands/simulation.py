"""The commands `simulate` and `excite`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ...deadline import DEFAULT_TIME_LIMIT, time_limit
from ...errors import OptionError
from ..app import (
    MAX_MAGNITUDE,
    Effects,
    RobotArguments,
    RunOptions,
    SimulationArguments,
    Text,
    Texts,
    TimeLimit,
    command,
    complete_law,
    option,
    output_option,
)
from ..arguments import given_effects, given_model, given_recordings, simulation_inputs
from ..terminal import bars, check_file
from .drives import SERVO_PREFIX, injected_numbers

if TYPE_CHECKING:
    from ...model import Model
    from ...simulation.excite import Excitation, Separation
    from ...simulation.plant import Torques
    from ...simulation.plant.control import Tracking
    from ...types import Array, Recording, Robot, Trajectory

DEFAULT_DURATION = 20.0  # default length of random motions [s]
DEFAULT_RATE, DEFAULT_COMMAND_RATE = 250.0, 100.0  # [Hz] of recordings, and of the commands of random motions
MAX_FEED_FORWARD = 10.0  # share of the rigid-body torque that can be fed forward
MIN_SCALE, MAX_SCALE = 1e-3, 10.0  # shares of limits that a motion may use


@dataclass(frozen=True, kw_only=True)
class SimulateOptions:
    """Motion, injected laws, integration and output of a simulation."""

    output: Text = output_option("The recording: .csv, .csv.gz, .parquet or .npz. Needed, unless --json.", "FILE")
    servo: bool = option(False, "Drive the joints through the position drives of SIMULATION.", "--servo")
    motion: Text = option(None, "Desired motion: t, q_J (dq_J, ddq_J). Default: random.", metavar="FILE")
    torque: Text = option(None, "Play back its torque in open loop.", metavar="RECORDING")
    inject: Texts = option(
        None,
        "EFFECT[@JOINT][:key=value,...], added to the laws of SIMULATION and unknown to the controller. "
        "Omitted parameters take their usual values. Repeatable; signid effects lists them. With --servo also "
        "servo@JOINT:kp=20,delay=0.01.",
        metavar="LAW",
        autocompletion=complete_law,
    )
    duration: float | None = option(None, "Duration [s]. Default: that of the motion or torque, or 20.", metavar="S")
    step: float = option(1e-3, "Time step of controller and dynamics [s].", metavar="S")
    integrator: str = option("semi-implicit", "semi-implicit or rk4.", metavar="HOW")
    substeps: int = option(0, "Substeps per step; 0: as many as the stiffest law needs.", metavar="N", min=0)


@dataclass(frozen=True, kw_only=True)
class LoopOptions:
    """The position controller."""

    bandwidth: float | None = option(None, "Bandwidth of the position loop [Hz]. Default: 6.", metavar="HZ")
    kp: Text = option(None, "Stiffness of the loop [N.m/rad]; needs --kd.", metavar="A,B")
    kd: Text = option(None, "Damping of the loop [N.m.s/rad]; needs --kp.", metavar="A,B")
    feed_forward: float | None = option(
        None, "Share of the rigid-body torque that is fed forward. Default: 1.", metavar="SHARE"
    )


@dataclass(frozen=True, kw_only=True)
class SensorOptions:
    """Sensors of the simulated robot."""

    rate: float | None = option(
        None, "Sampling rate of the recording [Hz]. Default: 250, with --servo that of the commands.", metavar="HZ"
    )
    encoder_bits: float | None = option(None, "2**N counts per turn or metre. Default: exact.", metavar="N")
    noise: float = option(0.0, "White torque noise, relative to the rms torque.", metavar="SHARE")
    coloured_noise: float = option(0.0, "Torque noise below 3 Hz, relative to the rms torque.", metavar="SHARE")
    jitter: float = option(0.0, "Jitter, relative to the sampling period.", metavar="SHARE")
    drop_outs: float = option(0.0, "Share of rows lost, in bursts.", metavar="SHARE")
    unsigned: bool = option(False, "Record torque without its sign.", "--unsigned")


@command("signid simulate 3r --inject coulomb_friction@2 -o recording.csv")
def simulate(
    plant: SimulateOptions,
    loop: LoopOptions,
    sensors: SensorOptions,
    simulation: SimulationArguments,
    run: RunOptions,
    commands: Annotated[
        str | None, typer.Argument(metavar="[COMMANDS]", help="With --servo: its q_des_J drive.")
    ] = None,
) -> int:
    """Simulate a robot with injected laws, and record it.

    A position and velocity controller follows --motion, with the rigid-body torque of SIMULATION as feed-forward.
    Without --motion the robot moves at random within its limits, from rest to rest. Joints without a column in the
    motion are held.

    With --servo the position drives of SIMULATION (a model.json with servos, or [joint.J.servo] of an actuators file)
    follow the q_des_J of COMMANDS, or the motion; the recording holds q_J, dq_J, q_des_J and on_J, without torque.

    Raises:
        OptionError: a single row.
    """
    from ...effects.naming import parse_law
    from ...model import Model, torque_model
    from ...output.report.results.recordings import SimulationRun
    from ...servo.given import stated_servos
    from ...simulation.plant import Sensors, Torques, record, simulate as move
    from ..terminal import deliver

    read = [plant.motion, plant.torque, commands, simulation.simulation, simulation.actuators]
    check_file(plant.output, run.json, read)
    if plant.servo or commands is not None:
        return _through_drives(commands, plant, loop, sensors, simulation, run)
    recorded = Sensors(**{**vars(sensors), "rate": DEFAULT_RATE if sensors.rate is None else sensors.rate})
    recorded.every(plant.step)
    known, asked = given_model(simulation, plant.motion, plant.torque)
    drive, seconds = _drive(known, asked, loop, plant.duration, plant.step, run.seed)
    if recorded.rate and plant.step <= seconds <= 1 / recorded.rate:
        raise OptionError(
            f"{seconds:g} s at {recorded.rate:g} Hz are a single row; give a longer duration or a higher --rate"
        )
    injected = tuple(parse_law(text, known.robot) for text in plant.inject or ())
    model = Model(known.robot, known.inertials, (*torque_model(known).laws, *injected))
    with bars(run.json) as progress:
        moved = move(
            model,
            drive,
            seconds,
            step=plant.step,
            integrator=plant.integrator,
            substeps=plant.substeps,
            progress=progress,
        )
    columns = record(known.robot, moved, recorded, desired=not isinstance(drive, Torques), seed=run.seed)
    idle = tuple({**stated_servos(known.robot), **known.servos})
    done = SimulationRun(model, injected, moved, columns, recorded, drive, plant.integrator, idle)
    inputs = simulation_inputs(simulation, known.robot, motion=plant.motion, torque=plant.torque)
    return deliver(done, inputs, plant.output, run.json, columns=done.columns, seed=run.seed)


def _through_drives(
    commands: str | None,
    plant: SimulateOptions,
    loop: LoopOptions,
    sensors: SensorOptions,
    simulation: SimulationArguments,
    run: RunOptions,
) -> int:
    """Simulate and record the closed loop of position drives."""
    from ...effects.naming import parse_law
    from ...servo.simulate import simulate_servos
    from ...simulation.excite.families import rest_to_rest_motion
    from ...simulation.plant import Sensors
    from ...types import Trajectory
    from ..terminal import deliver

    if plant.torque is not None or loop != LoopOptions():
        raise OptionError("--servo takes kp and kd from the model; leave --torque, --bandwidth, --kp, --kd out")
    if commands is not None and plant.motion is not None:
        raise OptionError("the commands of a recording and --motion both drive the joints; give one of them")
    if plant.duration is not None and (commands or plant.motion):
        raise OptionError("--duration applies to random motions; with given commands, leave it out")
    known, asked = given_model(simulation, plant.motion)
    texts = plant.inject or ()
    laws = [parse_law(text, known.robot) for text in texts if not text.startswith(SERVO_PREFIX)]
    numbers = dict(injected_numbers(text, known.robot) for text in texts if text.startswith(SERVO_PREFIX))
    given: Recording | Trajectory
    if commands is not None:
        [given] = given_recordings([commands], known.robot, None)
    elif isinstance(asked, Trajectory):
        given = asked
    else:
        seconds = DEFAULT_DURATION if plant.duration is None else plant.duration
        given = rest_to_rest_motion(known.robot, seconds, 1 / (sensors.rate or DEFAULT_COMMAND_RATE), run.seed)
    done = simulate_servos(
        known, given, Sensors(**vars(sensors)), inject=laws, numbers=numbers, injected=texts, seed=run.seed
    )
    inputs = simulation_inputs(simulation, known.robot, commands=commands, motion=plant.motion)
    return deliver(done, inputs, plant.output, run.json, columns=done.columns, seed=run.seed)


def _drive(
    known: Model, asked: Trajectory | Torques | None, loop: LoopOptions, duration: float | None, step: float, seed: int
) -> tuple[Tracking | Torques, float]:
    """The drive of the robot and the duration [s]; without a motion or torques from a file, a random motion."""
    from ...simulation.excite.families import rest_to_rest_motion
    from ...simulation.plant import Torques, track
    from ...simulation.plant.plant import instants

    if isinstance(asked, Torques):
        if loop != LoopOptions():
            raise OptionError("--torque is played back open loop; leave --bandwidth, --kp, --kd, --feed-forward out")
        return asked, float(asked.t[-1]) if duration is None else duration
    if asked is None:
        t = instants(DEFAULT_DURATION if duration is None else duration, step)
        asked = rest_to_rest_motion(known.robot, len(t) * step, step, seed)
    gains = None
    if loop.kp is not None or loop.kd is not None:
        if loop.kp is None or loop.kd is None or loop.bandwidth is not None:
            raise OptionError("--kp and --kd belong together and exclude --bandwidth; give both or neither")
        gains = (_numbers("--kp", loop.kp, known.robot), _numbers("--kd", loop.kd, known.robot))
    options = {"bandwidth": loop.bandwidth, "feed_forward": loop.feed_forward}
    stated = {key: value for key, value in options.items() if value is not None}
    if not all(abs(value) < float("inf") for value in stated.values()):
        raise OptionError("--bandwidth and --feed-forward must be finite; give the bandwidth in Hz and a share")
    if not abs(stated.get("feed_forward", 1.0)) <= MAX_FEED_FORWARD:
        raise OptionError(f"--feed-forward is {stated['feed_forward']:g}; give a share, up to {MAX_FEED_FORWARD:g}")
    return track(known, asked, gains=gains, **stated), float(asked.t[-1]) if duration is None else duration


def _numbers(option: str, text: str, robot: Robot) -> Array:
    """One number for all joints, () [units of the option], or one per joint, (n,)."""
    import numpy as np

    n = len(robot.joints)
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.empty(0)
    if len(values) not in (1, n) or not (np.abs(values) <= MAX_MAGNITUDE).all():
        raise OptionError(
            f"{option} {text!r} is neither one number nor one for each of the {n} joints; separate them by commas"
        )
    return values[0] if len(values) == 1 else values


@dataclass(frozen=True, kw_only=True)
class ExciteOptions:
    """Objective, parameters and limits of a motion."""

    output: Text = output_option("The motion: .csv, .csv.gz, .parquet or .npz. Needed, unless --json.", "FILE")
    separate: Texts = option(
        None, "Two laws EFFECT[@JOINT][:key=value,...] to discriminate instead.", "--separate", metavar="A,B"
    )
    kind: str = option("fourier", "Motion: fourier, spline, or random (not optimised).", metavar="KIND")
    criterion: str = option("determinant", "Optimality criterion: determinant or condition.", metavar="WHICH")
    duration: float = option(20.0, "Length of the motion [s].", metavar="S")
    harmonics: int | None = option(None, "Number of harmonics. Default: 10; 5 with --separate.", metavar="N")
    base_frequency: float | None = option(
        None, "Frequency of the first harmonic [Hz]. Default: 1 / duration.", metavar="HZ"
    )
    velocity_scale: float = option(1.0, "Share of the robot's velocity limits to use.", metavar="SHARE")
    acceleration_scale: float = option(1.0, "Share of the robot's acceleration limits to use.", metavar="SHARE")
    torque_scale: float = option(1.0, "Share of the robot's torque limits to use.", metavar="SHARE")
    clearance: float = option(0.01, "Minimum distance between links [m].", metavar="M")
    rate: float = option(100.0, "Sampling rate of the file [Hz].", metavar="HZ")
    effects: Effects = None
    time_limit: TimeLimit = DEFAULT_TIME_LIMIT


@command("signid excite 3r --duration 10 -o motion.csv")
def excite(excitation: ExciteOptions, robot: RobotArguments, run: RunOptions) -> int:
    """Compute an exciting motion, or one that discriminates two laws.

    The motion respects the limits, avoids self-collision, and begins and ends at rest. Its columns t, q_J, dq_J, ddq_J
    fit signid simulate --motion. With --separate the motion discriminates two laws; if no motion can, the exit code is
    3. Parameters of a law that are not given take their usual values.

    Raises:
        OptionError: a share of a limit is too small or too large.
    """
    from ...effects.naming import parse_law
    from ...simulation.excite import build_limits, excite as optimise, separate
    from ..terminal import deliver

    source = robot.simulation
    check_file(excitation.output, run.json, [source.simulation, source.actuators])
    model, _ = given_model(source)
    rivals = None
    if texts := excitation.separate:
        laws = split_laws(texts)
        if len(laws) != 2:
            fault = f"--separate {','.join(texts)!r} does not name two laws"
            raise OptionError(f"{fault}; write two, such as A@JOINT,B@JOINT")
        first, second = (parse_law(text, model.robot, partial=True) for text in laws)
        rivals = first, second
    scales = {name: getattr(excitation, f"{name}_scale") for name in ("velocity", "acceleration", "torque")}
    for name, scale in scales.items():
        if not MIN_SCALE <= scale <= MAX_SCALE:
            allowed = f"from {MIN_SCALE:g} to {MAX_SCALE:g}"
            raise OptionError(f"--{name}-scale is {scale:g}; give a share of the limits, {allowed}")
    limits = build_limits(model.robot)
    options: dict[str, Any] = {
        "duration": excitation.duration,
        "clearance": excitation.clearance,
        "rate": excitation.rate,
        "seed": run.seed,
        "limits": replace(limits, **{name: scale * getattr(limits, name) for name, scale in scales.items()}),
    }
    options |= {} if excitation.harmonics is None else {"harmonics": excitation.harmonics}
    found: Excitation | Separation
    with time_limit(excitation.time_limit), bars(run.json) as progress:
        if rivals is not None:
            found = separate(model, *rivals, **options, progress=progress)
        else:
            options |= {name: getattr(excitation, name) for name in ("kind", "criterion", "base_frequency")}
            found = optimise(model, effects=given_effects(excitation.effects), **options, progress=progress)
    inputs = simulation_inputs(source, model.robot)
    columns = motion_columns(found.trajectory)
    return deliver(found, inputs, excitation.output, run.json, columns=columns, robot=model.robot, seed=run.seed)


def motion_columns(trajectory: Trajectory) -> dict[str, Array]:
    """Columns t, q_J, dq_J and ddq_J, (N,) each [s, rad or m, rad/s or m/s, rad/s2 or m/s2]."""
    columns = {"t": trajectory.t.round(9)}
    for name, values in (("q", trajectory.q), ("dq", trajectory.v), ("ddq", trajectory.a)):
        columns |= {f"{name}_{joint}": x for joint, x in zip(trajectory.joints, values.T, strict=True)}
    return columns


def split_laws(texts: list[str]) -> list[str]:
    """Split comma-separated laws; commas between the parameters of a law are kept."""
    laws: list[str] = []
    for piece in (piece for text in texts for piece in text.split(",")):
        if laws and "=" in piece and ":" not in piece:
            laws[-1] += f",{piece}"
        else:
            laws.append(piece)
    return laws
