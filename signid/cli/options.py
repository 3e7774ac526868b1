"""Options that several commands share, and their expansion into parameters of a command.

Each group of options is a frozen dataclass whose fields are annotated for Typer. A command takes groups as parameters;
`expanded` shows Typer one parameter for each field.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import Annotated, Any, get_type_hints

import typer

from ..effects import EFFECT_NAMES

Texts = list[str] | None
LAST = ("seed", "json")  # options listed last in --help

SimulationName = Annotated[
    str, typer.Argument(metavar="SIMULATION", help="A model.json, a URDF, xacro or MJCF file, or a name such as panda.")
]
Recordings = Annotated[
    list[str], typer.Argument(metavar="RECORDING", help="CSV, Parquet, NPZ, ROS bag or LeRobot dataset.")
]
OutputFolder = Annotated[
    str | None, typer.Option("--output", "-o", metavar="DIR", help="Output folder. Needed, unless --json.")
]
HeldOut = Annotated[
    Texts, typer.Option(metavar="RECORDING", help="Held-out recording. Repeatable. Default: see above.")
]
Columns = Annotated[str | None, typer.Option(metavar="FILE", help='TOML of other column names: q_elbow = "elbow_pos".')]
Effects = Annotated[
    str | None, typer.Option(metavar="A,B", help=f"Laws at every joint, or none. Default: {', '.join(EFFECT_NAMES)}.")
]
Cutoff = Annotated[
    float | None,
    typer.Option(metavar="HZ", help="Filter cut-off [Hz]; inf disables filtering. Default: from the data."),
]
PackageDir = Annotated[
    Texts, typer.Option(metavar="DIR", help="Folder with packages of meshes and xacro files. Repeatable.")
]
Unsigned = Annotated[bool, typer.Option("--unsigned", help="Discard the signs of the torques.")]
TimeLimit = Annotated[
    float, typer.Option(metavar="S", help="Time limit for searches [s]; truncated results are flagged.")
]
Seed = Annotated[int, typer.Option(metavar="N", min=0, help="Seed of the random generator.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON and nothing else.")]


@dataclass(frozen=True, kw_only=True)
class RobotOptions:
    """How a robot description is read."""

    joints: Annotated[
        str | None, typer.Option(metavar="A,B", help="Joints that move; others are held. Default: all.")
    ] = None
    lock: Annotated[
        Texts, typer.Option(metavar="J=VALUE", help="Hold joint J at this position [rad or m]. Repeatable.")
    ] = None
    actuators: Annotated[
        str | None, typer.Option(metavar="FILE", help="TOML of the actuators. Default: actuators.toml.")
    ] = None
    package_dir: PackageDir = None


@dataclass(frozen=True, kw_only=True)
class SimulationArguments(RobotOptions):
    """A simulation: a robot description or a saved model."""

    simulation: SimulationName

    @property
    def saved(self) -> bool:
        """Whether it is a model.json, which states joints and actuators itself."""
        return self.simulation.endswith(".json")


@dataclass(frozen=True, kw_only=True)
class RobotArguments(RobotOptions):
    """A robot description."""

    robot: Annotated[str, typer.Argument(metavar="ROBOT", help="A URDF, xacro or MJCF file, or a name such as panda.")]

    @property
    def simulation(self) -> SimulationArguments:
        """The simulation that the description states."""
        shared = {field.name: getattr(self, field.name) for field in fields(RobotOptions)}
        return SimulationArguments(simulation=self.robot, **shared)


@dataclass(frozen=True, kw_only=True)
class RowOptions:
    """How recordings are read and turned into regression rows."""

    columns: Columns = None
    effects: Effects = None
    cutoff: Cutoff = None
    derivatives: Annotated[
        str,
        typer.Option(
            metavar="WHICH", help="Source of velocity and acceleration: computed (from q_J), recorded, or auto."
        ),
    ] = "auto"
    no_instruments: Annotated[
        bool, typer.Option("--no-instruments", help="Do not use q_des_J columns as instruments.")
    ] = False
    white: Annotated[bool, typer.Option("--white", help="Assume white torque noise instead of coloured noise.")] = False


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of every command that computes."""

    seed: Seed = 0
    json: Json = False


def expanded(function: Callable[..., int]) -> Callable[..., int]:
    """Replace each group of options in a command's signature by one parameter per field, for Typer.

    Args:
        function: command; parameters annotated with a dataclass are groups.
    """
    flat: list[Parameter] = []
    groups: dict[str, tuple[type[Any], tuple[str, ...]]] = {}
    for parameter in signature(function, eval_str=True).parameters.values():
        if is_dataclass(parameter.annotation) and isinstance(parameter.annotation, type):
            own = _parameters(parameter.annotation)
            groups[parameter.name] = parameter.annotation, tuple(option.name for option in own)
            flat += own
        else:
            flat.append(parameter.replace(kind=Parameter.KEYWORD_ONLY))

    flat.sort(key=lambda parameter: parameter.name in LAST)

    @wraps(function)
    def command(**given: Any) -> int:
        taken = {name: kind(**{key: given.pop(key) for key in keys}) for name, (kind, keys) in groups.items()}
        return function(**given, **taken)

    command.__signature__ = Signature(flat)  # type: ignore[attr-defined]
    return command


def _parameters(group: type[Any]) -> list[Parameter]:
    hints: Mapping[str, Any] = get_type_hints(group, include_extras=True)
    return [
        Parameter(
            field.name,
            Parameter.KEYWORD_ONLY,
            default=Parameter.empty if field.default is MISSING else field.default,
            annotation=hints[field.name],
        )
        for field in fields(group)
    ]
