"""The command `excite`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from ...deadline import USUAL, time_limit as limited
from ...errors import OptionError
from ..app import app
from ..arguments import Actuators, Effects, Joints, Json, Lock, PackageDir, RobotName, Seed, TimeLimit, given_effects
from ..output import check_file, write_columns
from ..source import Source, given_model
from ..terminal import bars, tell_flags

if TYPE_CHECKING:
    from ...simulation.excite import Excitation, Limits, Separation
    from ...types import Array, Law, Robot, Trajectory

Output = Annotated[
    str | None,
    typer.Option(
        "--output", "-o", metavar="FILE", help="The motion: .csv, .csv.gz, .parquet or .npz. Needed, unless --json."
    ),
]
Scale = Annotated[float, typer.Option(metavar="SHARE", help="Of the limits that ROBOT states.")]
Apart = Annotated[
    list[str] | None,
    typer.Option("--separate", metavar="A,B", help="Two laws EFFECT[@JOINT][:key=value,...] to tell apart instead."),
]


@app.command(epilog="Example: signid excite 3r --duration 10 -o motion.csv")
def excite(
    robot: RobotName,
    output: Output = None,
    separate: Apart = None,
    kind: Annotated[str, typer.Option(metavar="KIND", help="fourier, spline, or random (not sought).")] = "fourier",
    criterion: Annotated[
        str, typer.Option(metavar="WHICH", help="What is best: determinant or condition.")
    ] = "determinant",
    duration: Annotated[float, typer.Option(metavar="S", help="Of the motion [s].")] = 20.0,
    harmonics: Annotated[
        int | None, typer.Option(metavar="N", help="Of the motion. Default: 10; 5 to separate.")
    ] = None,
    base_frequency: Annotated[
        float | None, typer.Option(metavar="HZ", help="Of the first [Hz]. Default: 1 / duration.")
    ] = None,
    velocity_scale: Scale = 1.0,
    acceleration_scale: Scale = 1.0,
    torque_scale: Scale = 1.0,
    clearance: Annotated[float, typer.Option(metavar="M", help="Between links, at least [m].")] = 0.01,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Of the rows [Hz].")] = 100.0,
    effects: Effects = None,
    joints: Joints = None,
    lock: Lock = None,
    actuators: Actuators = None,
    package_dir: PackageDir = None,
    time_limit: TimeLimit = USUAL,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """A motion that tells most, or that tells two laws apart.

    It keeps within the limits and clear of the robot's own links, and begins and ends at rest: t, q_J, dq_J, ddq_J,
    ready for signid simulate --motion. With --separate it is the one that tells two laws apart, or the finding (exit
    code 3) that none does. The numbers of a law that are not stated are usual ones.
    """
    from ...output.report import Screen, excitation_document, excitation_tables, to_json
    from ...simulation.excite import excite as search, separate as part

    check_file(output, json)
    source = Source(robot, joints, lock, actuators, package_dir)
    model, _ = given_model(source)
    options: dict[str, Any] = {"duration": duration, "clearance": clearance, "rate": rate, "seed": seed}
    options["limits"] = _limits(model.robot, velocity_scale, acceleration_scale, torque_scale)
    options |= {} if harmonics is None else {"harmonics": harmonics}
    rivals = _rivals(separate, model.robot)
    found: Excitation | Separation
    with limited(time_limit), bars(json) as progress:
        options["progress"] = progress
        if rivals is None:
            options |= {"kind": kind, "criterion": criterion, "base_frequency": base_frequency}
            found = search(model, effects=given_effects(effects), **options)
        else:
            found = part(model, *rivals, **options)
    document = to_json(excitation_document(model.robot, found, source.inputs(model.robot), seed))
    written, screen = write_columns(output, motion_columns(found.trajectory)), Screen()
    if json:
        screen.write(document)
    else:
        screen.print(*excitation_tables(model.robot, found), sep="\n")
    code = tell_flags(found.flags)
    if written and not json:
        screen.write("\n".join(["", "written:", *(f"  {path}" for path in written), ""]))
    return code


def motion_columns(trajectory: Trajectory) -> dict[str, Array]:
    """Columns t, q_J, dq_J and ddq_J, (N,) each [s, rad or m, rad/s or m/s, rad/s2 or m/s2]."""
    columns = {"t": trajectory.t.round(9)}
    for name, values in (("q", trajectory.q), ("dq", trajectory.v), ("ddq", trajectory.a)):
        columns |= {f"{name}_{joint}": x for joint, x in zip(trajectory.joints, values.T, strict=True)}
    return columns


def split_laws(texts: list[str]) -> list[str]:
    """Laws that commas part, each with the commas of its own numbers."""
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


def _limits(robot: Robot, velocity: float, acceleration: float, torque: float) -> Limits:
    from dataclasses import replace

    from ...simulation.excite import build_limits

    given = {"velocity": velocity, "acceleration": acceleration, "torque": torque}
    for name, value in given.items():
        if not 0 < value < float("inf"):
            raise OptionError(f"--{name}-scale is {value:g}; give a share of the limits above 0")
    limits = build_limits(robot)
    return replace(limits, **{name: value * getattr(limits, name) for name, value in given.items()})
