"""The command `excite`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ...deadline import DEFAULT_TIME_LIMIT, time_limit
from ...errors import OptionError
from ..app import Text, Texts, command, option, output_option
from ..arguments import given_effects, given_model, simulation_inputs
from ..options import Effects, RobotArguments, RunOptions, TimeLimit
from ..terminal import bars, check_file

if TYPE_CHECKING:
    from ...simulation.excite import Excitation, Limits, Separation
    from ...types import Array, Law, Robot, Trajectory

MIN_SCALE, MAX_SCALE = 1e-3, 10.0  # shares of limits that a motion may use


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
    """
    from ...simulation.excite import excite as optimise, separate
    from ..files import deliver

    source = robot.simulation
    check_file(excitation.output, run.json, [source.simulation, source.actuators])
    model, _ = given_model(source)
    rivals = _rivals(excitation.separate, model.robot)
    options: dict[str, Any] = {
        "duration": excitation.duration,
        "clearance": excitation.clearance,
        "rate": excitation.rate,
        "seed": run.seed,
        "limits": _limits(model.robot, excitation),
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


def _rivals(texts: list[str] | None, robot: Robot) -> tuple[Law, Law] | None:
    from ...effects.naming import parse_law

    if not texts:
        return None
    laws = split_laws(texts)
    if len(laws) != 2:
        raise OptionError(f"--separate {','.join(texts)!r} does not name two laws; write two, such as A@JOINT,B@JOINT")
    first, second = (parse_law(text, robot, partial=True) for text in laws)
    return first, second


def _limits(robot: Robot, asked: ExciteOptions) -> Limits:
    from ...simulation.excite import build_limits

    given = {name: getattr(asked, f"{name}_scale") for name in ("velocity", "acceleration", "torque")}
    for name, value in given.items():
        if not MIN_SCALE <= value <= MAX_SCALE:
            allowed = f"from {MIN_SCALE:g} to {MAX_SCALE:g}"
            raise OptionError(f"--{name}-scale is {value:g}; give a share of the limits, {allowed}")
    limits = build_limits(robot)
    return replace(limits, **{name: value * getattr(limits, name) for name, value in given.items()})
