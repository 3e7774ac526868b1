"""The Typer application, options that several commands share, and their expansion into parameters of a command.

Each group of options is a frozen dataclass. Its fields are annotated for Typer, or have an `option` as default. A
command takes groups as parameters; `command` shows Typer one parameter for each field.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import Annotated, Any, get_type_hints

import typer

from ..effects import EFFECT_NAMES
from ..version import __version__

Text = str | None
Texts = list[str] | None
LAST = ("seed", "json")  # options listed last in --help

app = typer.Typer(
    name="signid",
    help="Identify and diagnose robot dynamics models from a robot description and recordings.",
    epilog="Exit codes: 0 done; 2 bad input or usage; 3 done, but the result is flagged and says why.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"signid {__version__}")
        raise typer.Exit


@app.callback()
def _signid(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def option(default: Any, text: str, *names: str, **settings: Any) -> Any:
    """Field of a group of options, with its default, the text of --help, its names and other settings of Typer."""
    return field(default=default, metadata={"option": typer.Option(*names, help=text, **settings)})


def output_option(text: str, metavar: str = "DIR") -> Any:
    """Field `--output`, or `-o`, of a group of options."""
    return option(None, text, "--output", "-o", metavar=metavar)


SimulationName = Annotated[
    str, typer.Argument(metavar="SIMULATION", help="A model.json, a URDF, xacro or MJCF file, or a name such as panda.")
]
Recordings = Annotated[
    list[str], typer.Argument(metavar="RECORDING", help="CSV, Parquet, NPZ, ROS bag or LeRobot dataset.")
]
Columns = Annotated[Text, typer.Option(metavar="FILE", help='TOML of other column names: q_elbow = "elbow_pos".')]
Effects = Annotated[
    Text, typer.Option(metavar="A,B", help=f"Laws at every joint, or none. Default: {', '.join(EFFECT_NAMES)}.")
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
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON and nothing else.")]


@dataclass(frozen=True, kw_only=True)
class RobotOptions:
    """How a robot description is read."""

    joints: Text = option(None, "Joints that move; others are held. Default: all.", metavar="A,B")
    lock: Texts = option(None, "Hold joint J at this position [rad or m]. Repeatable.", metavar="J=VALUE")
    actuators: Text = option(None, "TOML of the actuators. Default: actuators.toml.", metavar="FILE")
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
        shared = {item.name: getattr(self, item.name) for item in fields(RobotOptions)}
        return SimulationArguments(simulation=self.robot, **shared)


@dataclass(frozen=True, kw_only=True)
class RowOptions:
    """How recordings are read and turned into regression rows."""

    columns: Columns = None
    effects: Effects = None
    cutoff: Cutoff = None
    derivatives: str = option(
        "auto", "Source of velocity and acceleration: computed (from q_J), recorded, or auto.", metavar="WHICH"
    )
    no_instruments: bool = option(False, "Do not use q_des_J columns as instruments.", "--no-instruments")
    white: bool = option(False, "Assume white torque noise instead of coloured noise.", "--white")


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of every command that computes."""

    seed: int = option(0, "Seed of the random generator.", metavar="N", min=0)
    json: Json = False


def command(example: str) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Decorate a command of the application; the example of its use ends --help."""
    return lambda function: app.command(epilog=f"Example: {example}")(_expanded(function))


def _expanded(function: Callable[..., int]) -> Callable[..., int]:
    """Replace each group of options in a command's signature by one parameter per field, for Typer."""
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
    def run(**given: Any) -> int:
        taken = {name: kind(**{key: given.pop(key) for key in keys}) for name, (kind, keys) in groups.items()}
        return function(**given, **taken)

    run.__signature__ = Signature(flat)  # type: ignore[attr-defined]
    return run


def _parameters(group: type[Any]) -> list[Parameter]:
    found, hints = list[Parameter](), get_type_hints(group, include_extras=True)
    for item in fields(group):
        default = Parameter.empty if item.default is MISSING else item.default
        kind = Annotated[hints[item.name], item.metadata["option"]] if item.metadata else hints[item.name]
        found.append(Parameter(item.name, Parameter.KEYWORD_ONLY, default=default, annotation=kind))
    return found
