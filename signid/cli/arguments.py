"""Arguments of the command line, and what they are to the library."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..effects import EFFECT_NAMES
from ..errors import OptionError

if TYPE_CHECKING:
    from ..estimation.standard import Search
    from ..regression.session import Options
    from ..types import Input, Recording, Robot

RobotName = Annotated[str, typer.Argument(metavar="ROBOT", help="A URDF, xacro or MJCF file, or a name such as panda.")]
SimulationName = Annotated[
    str, typer.Argument(metavar="SIMULATION", help="A model.json, a URDF, xacro or MJCF file, or a name such as panda.")
]
Files = Annotated[list[str], typer.Argument(metavar="RECORDING", help="CSV, Parquet, NPZ, ROS bag or LeRobot dataset.")]
Joints = Annotated[str | None, typer.Option(metavar="A,B", help="Joints that move, others are held. Default: all.")]
Lock = Annotated[list[str] | None, typer.Option(metavar="J=VALUE", help="Hold joint J there [rad or m]. Repeatable.")]
Actuators = Annotated[str | None, typer.Option(metavar="FILE", help="TOML of the drives. Default: actuators.toml.")]
PackageDir = Annotated[list[str] | None, typer.Option(metavar="DIR", help="Packages of meshes and xacro. Repeatable.")]
Columns = Annotated[str | None, typer.Option(metavar="FILE", help='TOML of other names: q_elbow = "elbow_pos".')]
Effects = Annotated[
    str | None, typer.Option(metavar="A,B", help=f"Laws at every joint, or none. Default: {', '.join(EFFECT_NAMES)}.")
]
Cutoff = Annotated[float | None, typer.Option(metavar="HZ", help="Of the filter [Hz], or inf. Default: by the data.")]
Derivatives = Annotated[
    str, typer.Option(metavar="WHICH", help="Velocity and acceleration: computed (from q_J), recorded, or auto.")
]
EstimatorName = Annotated[
    str | None,
    typer.Option(
        "--estimator", metavar="HOW", help="wls, iv, tls or oe. Default: wls, with q_des_J as instruments if recorded."
    ),
]
Unsigned = Annotated[bool, typer.Option("--unsigned", help="Forget the signs of torque.")]
SignSearch = Annotated[
    str, typer.Option("--signs", metavar="HOW", help="Lost signs: exact, or tree (the classical tree of choices).")
]
Bounds = Annotated[str | None, typer.Option(metavar="FILE", help="TOML: box of pbrp. Default: around ROBOT's values.")]
GlobalAlgorithm = Annotated[str, typer.Option(metavar="NAME", help="NLopt's, of pbrp.")]
LocalAlgorithm = Annotated[str, typer.Option(metavar="NAME", help="NLopt's, of pbrp.")]
TotalMass = Annotated[str | None, typer.Option(metavar="LO,HI", help="Of all links [kg], for pbrp. Default: any.")]
NoInstruments = Annotated[bool, typer.Option("--no-instruments", help="Do without q_des_J columns as instruments.")]
White = Annotated[bool, typer.Option("--white", help="Take torque noise to be white, not coloured.")]
TimeLimit = Annotated[float, typer.Option(metavar="S", help="Of searches; one that it cuts short is flagged [s].")]
Seed = Annotated[int, typer.Option(metavar="N", min=0, help="Seed of everything random.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON and nothing else.")]


def again(context: typer.Context) -> str:
    """The command that was given, as one line for a shell; its folder of results is named DIR."""
    words = list(context.obj or ())
    for k, word in enumerate(words):
        if word in ("-o", "--output"):
            words[k + 1 : k + 2] = ["DIR"]
        elif word.startswith("--output="):
            words[k] = "--output=DIR"
        elif word.startswith("-o") and not word.startswith("--"):
            words[k] = "-oDIR"
    return shlex.join(["signid", *words]) if words else ""


def given_robot(
    name: str, joints: str | None, lock: list[str] | None, actuators: str | None, packages: list[str] | None
) -> Robot:
    """The robot with the joints held that are to be held.

    Raises:
        OptionError: a folder of packages does not exist, or a list of joints or a position makes no sense.
    """
    from ..robot import load_robot

    for folder in packages or ():
        if not Path(folder).is_dir():
            raise OptionError(f"--package-dir {folder} is no folder; name the folder that holds the packages")
    moving = None if joints is None else _names("--joints", joints)
    return load_robot(name, lock=_locks(lock or ()), joints=moving, actuators=actuators, package_dirs=packages or ())


def _locks(texts: Sequence[str]) -> dict[str, float]:
    held: dict[str, float] = {}
    for text in texts:
        joint, _, value = (part.strip() for part in text.rpartition("="))
        if joint in held:
            raise OptionError(f"--lock names joint {joint} twice; give one position for it")
        try:
            held[joint] = float(value if joint else "")
        except ValueError:
            raise OptionError(f"--lock {text!r} is not a joint and its position; write J=VALUE, in rad or m") from None
    return held


def given_recording(path: str, robot: Robot, columns: str | None, unsigned: bool = False) -> Recording:
    """The recording in a file."""
    from ..recording import read_recording

    return read_recording(path, robot, columns=columns, unsigned=unsigned)


def given_options(
    effects: str | None,
    cutoff: float | None,
    derivatives: str,
    plain: bool,
    white: bool,
    seed: int,
    robust: bool = False,
) -> Options:
    """How recordings are turned into rows."""
    from ..regression.session import Options

    return Options(given_effects(effects), cutoff, derivatives, not plain, not white, robust, seed)


def given_search(bounds: str | None, global_algorithm: str, local_algorithm: str, total_mass: str | None) -> Search:
    """How penalty-based parameter retrieval searches.

    Raises:
        OptionError: the range of the total mass is none.
    """
    from ..estimation.standard import Search

    total = None
    if total_mass is not None:
        try:
            low, high = (float(part) for part in total_mass.split(","))
        except ValueError:
            low, high = 1.0, 0.0
        if not 0 <= low <= high:
            raise OptionError(f"--total-mass {total_mass!r} is no range; write LO,HI in kg, with LO no greater than HI")
        total = (low, high)
    return Search(bounds, global_algorithm, local_algorithm, total)


def given_effects(text: str | None) -> tuple[str, ...]:
    """Names of effects."""
    if text is None:
        return EFFECT_NAMES
    return () if text == "none" else _names("--effects", text)


def _names(option: str, text: str) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",")))
    if not all(names):
        raise OptionError(f"{option} {text!r} has an empty name; separate names by single commas")
    return names


def given_inputs(name: str, robot: Robot, actuators: str | None, **files: str | None) -> list[Input]:
    """The description as it was given, and what was read beside it by what it holds."""
    from ..recording.source import digest_of
    from ..types import Input

    beside = Path(robot.path).with_name("actuators.toml")
    given = Path(name) if Path(name).is_dir() else Path(name).parent if Path(name).is_file() else Path(name)
    named = [(file, Path(file), role) for role, file in {"actuators": actuators, **files}.items() if file is not None]
    if actuators is None and beside.is_file():
        named.append((str(given / beside.name), beside, "actuators"))
    read = (Input(shown, digest_of(path), role) for shown, path, role in named)
    return [Input(name, robot.sha256, "description"), *read]
