"""The Typer application: its commands and their groups of options.

A group of options is a frozen dataclass. Its fields are annotated for Typer, or have an `option` as default. A command
takes groups as parameters; `command` shows Typer one parameter for each field.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, getdoc, signature
from math import isfinite
from typing import Annotated, Any, get_type_hints

import typer
from typer.core import TyperCommand

from ..effects import EFFECT_NAMES
from ..errors import OptionError
from ..version import __version__

Text = str | None
Texts = list[str] | None
TYPE = re.compile(r" <[\w\[\]]+>$")  # of an argument: "ROBOT <str>"
XACRO = re.compile(r"[A-Za-z_][\w.\-/]*:=")  # beginning of an argument of a xacro file
LAST_OPTIONS = ("seed", "json")  # options listed last in --help
MAX_MAGNITUDE, MIN_MAGNITUDE = 9e9, 1e-15  # magnitude of a number on the command line; 0 is smaller
MAX_SEED = 2**64 - 1
UNBOUNDED_OPTIONS = "cutoff time_limit duration bandwidth feed_forward".split()  # commands check these
app = typer.Typer(
    name="signid",
    help="Identify and diagnose robot dynamics models from a robot description and recordings.",
    epilog="Exit codes: 0 done; 2 bad input or usage; 3 done, but the result is flagged and says why.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
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


def command(example: str, *first: str) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Decorate a command of the application; the example of its use ends --help.

    If the options to show `first` are named, --help lists the others below, a section for each group.
    """
    kind = type("_Listed", (_Command,), {"first": first})

    def listed(function: Callable[..., int]) -> Callable[..., int]:
        text = (getdoc(function) or "").partition("\n\nRaises:")[0]
        return app.command(help=text, epilog=f"Example: {example}", cls=kind)(_expanded(function))

    return listed


class _Command(TyperCommand):
    """A command whose help names its arguments as users do, without the types of Python.

    A word NAME:=VALUE is an argument of the xacro file before it, as in ROS, if the command has --xacro.
    """

    first: tuple[str, ...] = ()

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        return super().parse_args(ctx, self._with_xacro(args))

    def _with_xacro(self, args: list[str]) -> list[str]:
        if all(parameter.name != "xacro" for parameter in self.params):
            return args
        flags = (parameter for parameter in self.params if not getattr(parameter, "is_flag", True))
        valued = {name for parameter in flags for name in (*parameter.opts, *parameter.secondary_opts)}
        end = args.index("--") if "--" in args else len(args)
        pairs = zip(args[:end], ["", *args], strict=False)
        words = [(["--xacro"] if XACRO.match(word) and before not in valued else []) + [word] for word, before in pairs]
        return [*(each for pair in words for each in pair), *args[end:]]

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        return [piece.replace("{", "").replace("}", "") for piece in super().collect_usage_pieces(ctx)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        sections: dict[str, list[Any]] = {"Arguments": [], "Options": []}
        for parameter in sorted(self.get_params(ctx), key=self._place):
            section = "Arguments" if parameter.param_type_name == "argument" else self._section(parameter)
            record = parameter.get_help_record(ctx)
            sections.setdefault(section, []).extend([record] if record else [])
        for title, rows in sections.items():
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)

    def _place(self, parameter: Any) -> int:
        return self.first.index(parameter.name) if parameter.name in self.first else len(self.first)

    def _section(self, parameter: Any) -> str:
        """Title of the section of an option: what its group is about."""
        groups = getattr(self.callback, "groups", {})
        apart = self.first and parameter.name not in (*self.first, "help")
        return groups.get(parameter.name, "Options") if apart else "Options"

    def format_help(self, ctx: Any, formatter: Any) -> None:
        write = formatter.write_dl
        formatter.write_dl = lambda rows, *rest, **more: write([(TYPE.sub("", a), b) for a, b in rows], *rest, **more)
        super().format_help(ctx, formatter)


def _expanded(function: Callable[..., int]) -> Callable[..., int]:
    """Replace each group of options in a command's signature by one parameter per field, for Typer."""
    flat: list[Parameter] = []
    groups: dict[str, tuple[type[Any], tuple[str, ...]]] = {}
    for parameter in signature(function, eval_str=True).parameters.values():
        if is_dataclass(parameter.annotation) and isinstance(parameter.annotation, type):
            options, hints = list[Parameter](), get_type_hints(parameter.annotation, include_extras=True)
            for item in fields(parameter.annotation):
                default = Parameter.empty if item.default is MISSING else item.default
                kind = Annotated[hints[item.name], item.metadata["option"]] if item.metadata else hints[item.name]
                options.append(Parameter(item.name, Parameter.KEYWORD_ONLY, default=default, annotation=kind))
            groups[parameter.name] = parameter.annotation, tuple(option.name for option in options)
            flat += options
        else:
            flat.append(parameter.replace(kind=Parameter.KEYWORD_ONLY))
    flat.sort(key=lambda parameter: parameter.name in LAST_OPTIONS)

    @wraps(function)
    def run(**given: Any) -> int:
        for parameter in flat:
            _bound(parameter, given[parameter.name])
        taken = {name: kind(**{key: given.pop(key) for key in keys}) for name, (kind, keys) in groups.items()}
        return function(**given, **taken)

    run.__signature__ = Signature(flat)  # type: ignore[attr-defined]
    titles = {key: (kind.__doc__ or "").rstrip(".") for kind, keys in groups.values() for key in keys}
    run.groups = titles  # type: ignore[attr-defined]
    return run


def _bound(parameter: Parameter, value: Any) -> None:
    """Check the magnitude of an option, if it is a number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return
    if isfinite(value) or parameter.name not in UNBOUNDED_OPTIONS:
        settings = getattr(parameter.annotation, "__metadata__", ())
        names = (name for setting in settings for name in getattr(setting, "param_decls", None) or ())
        shown = next((name for name in names if name.startswith("--")), f"--{parameter.name.replace('_', '-')}")
        bounded(shown, value, MAX_SEED if parameter.name == "seed" else MAX_MAGNITUDE)


def bounded(option: str, value: float, most: float = MAX_MAGNITUDE) -> float:
    """The number of an option, small enough that no product, ratio or count of it overflows.

    Raises:
        OptionError: the number is not finite, too large, or too small without being 0.
    """
    if value != 0 and not MIN_MAGNITUDE <= abs(value) <= most:
        raise OptionError(
            f"{option} is {value:.6g}; give 0 or a finite magnitude between {MIN_MAGNITUDE:.0e} and {most:.3g}"
        )
    return value


def complete_robot(incomplete: str) -> list[str]:
    """Names of robots that begin with a text."""
    from ..robot.locate import names

    return _beginning(incomplete, names())


def complete_law(incomplete: str) -> list[str]:
    """Names of laws that begin with a text; in a list, those of its last name."""
    from ..effects import DRIVE_EFFECTS, EFFECTS

    before, comma, last = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in _beginning(last, [*EFFECTS.names, *DRIVE_EFFECTS.names])]


def complete_data(incomplete: str) -> list[str]:
    """Names of public data sets that begin with a text."""
    from ..recording.gallery import DATA

    return _beginning(incomplete, (data.name for data in DATA))


def complete_number(incomplete: str) -> list[str]:
    """Names of numbers of a drive that begin with a text, up to their value."""
    from ..servos import SERVO_NUMBERS

    return _beginning(incomplete, (f"{name}=" for name in SERVO_NUMBERS))


def complete_known(incomplete: str) -> list[str]:
    """Sources of the scale of torque, and names of numbers of a drive."""
    return [*_beginning(incomplete, ("masses", "nothing")), *complete_number(incomplete)]


def _beginning(text: str, names: Iterable[str]) -> list[str]:
    return [name for name in names if name.startswith(text)]


SimulationName = Annotated[
    str,
    typer.Argument(
        metavar="SIMULATION",
        help="A model.json, a URDF, xacro or MJCF file, or a name such as panda.",
        autocompletion=complete_robot,
    ),
]
RobotName = Annotated[
    str,
    typer.Argument(
        metavar="ROBOT", help="A URDF, xacro or MJCF file, or a name such as panda.", autocompletion=complete_robot
    ),
]
RECORDING_ARGUMENT = typer.Argument(metavar="RECORDING", help="CSV, Parquet, NPZ, ROS bag or LeRobot dataset.")
RecordingName = Annotated[str, RECORDING_ARGUMENT]
Recordings = Annotated[list[str], RECORDING_ARGUMENT]
OptionalRecordings = Annotated[Texts, RECORDING_ARGUMENT]
Columns = Annotated[Text, typer.Option(metavar="FILE", help='TOML of other column names: q_elbow = "elbow_pos".')]
Rate = Annotated[
    float | None,
    typer.Option(
        metavar="HZ", help="Rate of rows without times [Hz]; 0: postures at rest. Default: their column of time."
    ),
]
Effects = Annotated[
    Text,
    typer.Option(
        metavar="A,B",
        help=f"Laws at every joint, or none. Default: {', '.join(EFFECT_NAMES)}.",
        autocompletion=complete_law,
    ),
]
Cutoff = Annotated[
    float | None,
    typer.Option(metavar="HZ", help="Filter cut-off [Hz]; inf disables filtering. Default: from the data."),
]
PackageDir = Annotated[
    Texts, typer.Option(metavar="DIR", help="Folder with packages of meshes and xacro files. Repeatable.")
]
Xacro = Annotated[
    Texts,
    typer.Option(
        "--xacro",
        metavar="NAME:=VALUE",
        help="Argument of a xacro file; also as a word of its own after the file. Default: that of the file. "
        "Repeatable.",
    ),
]
Gravity = Annotated[
    Text,
    typer.Option(
        metavar="X,Y,Z",
        help="Gravity [m/s2] in the frame of the root link; 0,0,0: the torque carries no weight. Default: 0,0,-9.81.",
    ),
]
Unsigned = Annotated[bool, typer.Option("--unsigned", help="Discard the signs of the torques.")]
TimeLimit = Annotated[
    float, typer.Option(metavar="S", help="Time limit for searches [s]; truncated results are flagged.")
]
Rrd = Annotated[Text, typer.Option("--rrd", metavar="FILE", help="Log for Rerun (extra viewers). Default: none.")]
Mcap = Annotated[
    Text,
    typer.Option(
        "--mcap", metavar="FILE", help="Log for Foxglove, RViz and PlotJuggler (extra viewers). Default: none."
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON and nothing else.")]


@dataclass(frozen=True, kw_only=True)
class RobotOptions:
    """How a robot description is read."""

    joints: Text = option(None, "Joints that move; others are held. Default: all.", metavar="A,B")
    lock: Texts = option(None, "Hold joint J at this position [rad or m]. Repeatable.", metavar="J=VALUE")
    actuators: Text = option(None, "TOML of the actuators. Default: actuators.toml.", metavar="FILE")
    package_dir: PackageDir = None
    gravity: Gravity = None
    xacro: Xacro = None


@dataclass(frozen=True, kw_only=True)
class SimulationArguments(RobotOptions):
    """A simulation: a robot description or a saved model."""

    simulation: SimulationName

    @property
    def saved(self) -> bool:
        """Whether it is a saved or published model, which states joints and actuators itself."""
        from ..robot import saved_model

        described = any((self.joints, self.lock, self.actuators, self.xacro)) and not self.simulation.endswith(".json")
        return not described and saved_model(self.simulation) is not None


@dataclass(frozen=True, kw_only=True)
class RobotArguments(RobotOptions):
    """A robot description."""

    robot: RobotName

    @property
    def simulation(self) -> SimulationArguments:
        """The simulation that the description states."""
        shared = {item.name: getattr(self, item.name) for item in fields(RobotOptions)}
        return SimulationArguments(simulation=self.robot, **shared)


@dataclass(frozen=True, kw_only=True)
class RowOptions:
    """How recordings are read and turned into regression rows."""

    columns: Columns = None
    rate: Rate = None
    effects: Effects = None
    cutoff: Cutoff = None
    derivatives: str = option(
        "auto", "Source of velocity and acceleration: computed (from q_J), recorded, or auto.", metavar="WHICH"
    )
    no_instruments: bool = option(False, "Do not use q_des_J columns as instruments.", "--no-instruments")
    white: bool = option(False, "Assume white torque noise instead of coloured noise.", "--white")


@dataclass(frozen=True, kw_only=True)
class DriveOptions:
    """Position drives: joints with commanded positions and without torque."""

    servo: bool = option(False, "Identify position drives even if torque is recorded.", "--servo")
    known: Texts = option(
        None,
        "Servo mode: scale of torque, masses, nothing or kp=20 [N.m/rad]; default: stated kp, else masses. Or a number "
        "that is not fitted: NAME=VALUE, or NAME@PATTERN=VALUE at joints that a pattern matches. Repeatable.",
        metavar="WHAT",
        autocompletion=complete_known,
    )
    prior: Texts = option(
        None,
        "Prior of a number of a drive: NAME=MEAN+-STD or NAME@PATTERN=MEAN+-STD. Repeatable.",
        metavar="PRIOR",
        autocompletion=complete_number,
    )
    equal: Texts = option(
        None,
        "Regular expression of joints with equal drives, fitted as one: '.*_hip_joint'. Repeatable.",
        metavar="PATTERN",
    )
    law: Texts = option(
        None,
        "Law of the drives, or J=LAW: effort, duty or torque_speed. Default: by evidence. Repeatable.",
        metavar="LAW",
    )
    compare_models: bool = option(
        False, "Compare friction models (M1 to M6 of BAM, PACE) by held-out error and evidence.", "--compare-models"
    )


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of every command that computes."""

    seed: int = option(0, "Seed of the random generator.", metavar="N", min=0)
    json: Json = False
