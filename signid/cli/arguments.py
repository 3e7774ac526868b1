"""Conversion of command-line arguments into arguments of the library."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import typer

from ..effects import EFFECT_NAMES
from ..errors import InputError, OptionError, OutputError, UndecidedReading, readable
from .app import DriveOptions, RobotOptions, RowOptions, SimulationArguments, bounded

if TYPE_CHECKING:
    from ..model import Model
    from ..regression.session import Options
    from ..simulation.plant import Torques
    from ..types import Input, Reading, Recording, Robot, Trajectory

Given = TypeVar("Given", bound=RobotOptions)
MAX_HELD_POSITION = 1e4  # position of a held joint [rad or m]
TORQUE_OPTIONS = (  # options of `identify` that act on torque
    *("method", "estimator", "robust", "unsigned", "signs", "global_algorithm", "local_algorithm"),
    *("total_mass", "effects", "cutoff", "derivatives", "no_instruments", "white", "refine"),
)


def given_command(context: typer.Context) -> str:
    """Return the command as one shell line, with DIR as the name of its output folder."""
    words = list(context.obj or ())
    for k, word in enumerate(words):
        if word in ("-o", "--output"):
            words[k + 1 : k + 2] = ["DIR"]
        elif word.startswith("--output="):
            words[k] = "--output=DIR"
        elif word.startswith("-o") and not word.startswith("--"):
            words[k] = "-oDIR"
    return readable(shlex.join(["signid", *words])) if words else ""


def given_robot(name: str, options: RobotOptions) -> Robot:
    """Load a robot with the requested joints held.

    Raises:
        OptionError: a package folder does not exist, or a list of joints or a position is invalid.
    """
    from ..robot import load_robot
    from ..robot.joints import parse_gravity
    from ..robot.load import parse_arguments

    packages = options.package_dir or ()
    for folder in packages:
        if not Path(folder).is_dir():
            raise OptionError(f"--package-dir {folder} is not a folder; name the folder that holds the packages")
    moving = None if options.joints is None else _names("--joints", options.joints)
    held: dict[str, float] = {}
    for text in options.lock or ():
        joint, _, value = (part.strip() for part in text.rpartition("="))
        if joint in held:
            raise OptionError(f"--lock names joint {joint} twice; give one position for it")
        try:
            held[joint] = bounded(f"--lock {joint}", float(value if joint else ""), MAX_HELD_POSITION)
        except OptionError:
            raise
        except ValueError:
            raise OptionError(f"--lock {text!r} is not a joint and its position; write J=VALUE, in rad or m") from None
    return load_robot(
        name,
        lock=held,
        joints=moving,
        actuators=options.actuators,
        package_dirs=packages,
        gravity=None if options.gravity is None else parse_gravity(options.gravity),
        xacro=parse_arguments(options.xacro or ()),
    )


def given_model(
    source: SimulationArguments, motion: str | None = None, torque: str | None = None
) -> tuple[Model, Trajectory | Torques | None]:
    """Load a model and the motion or torque that drives it, from files; hold joints without a column in these files.

    Raises:
        OptionError: the arguments contradict each other.
    """
    from ..model import Model, load_model, stated_inertials, stated_laws
    from ..robot import hold, resting
    from ..robot.joints import parse_gravity
    from ..simulation.plant import read_motion, recorded_torques

    name = source.simulation
    if motion is not None and torque is not None:
        raise OptionError("--motion and --torque both drive the robot; give one of them")
    if source.saved and source.xacro:
        raise OptionError(f"{name} is no xacro file: it holds the expanded description; leave --xacro out")
    if source.saved and any((source.joints, source.lock, source.actuators, source.package_dir)):
        raise OptionError(f"{name} states its joints and actuators itself; leave --joints, --lock, --actuators out")
    gravity = None if source.gravity is None else parse_gravity(source.gravity)
    model = load_model(name, gravity=gravity) if source.saved else None
    robot = model.robot if model else given_robot(name, source)
    asked: Trajectory | Torques | None = None
    moving = robot.joints
    if motion is not None:
        asked = read_motion(motion, robot)
        moving = asked.joints
    if torque is not None:
        [recording] = given_recordings([torque], robot, None)
        asked, moving = recorded_torques(recording), recording.joints
    if model is None:
        robot = hold(robot, resting(robot, but=moving))
        model = Model(robot, stated_inertials(robot), stated_laws(robot))
    if moving != robot.joints:
        lacking = ", ".join(joint for joint in robot.joints if joint not in moving)
        raise OptionError(f"{motion or torque} has no position of {lacking}; {name} moves all of its joints")
    return model, asked


def given_recordings(
    paths: Iterable[str] | None,
    robot: Robot,
    columns: str | None,
    unsigned: bool = False,
    rate: float | None = None,
    *,
    output: str | None = None,
    quiet: bool = True,
) -> list[Recording]:
    """Read recordings with a column map file, rows of a `rate` [Hz], or by their readings.

    `unsigned` discards the signs of torques. A drafted reading with lines to choose is written beside the recording,
    or into the folder `output`. Unless `quiet`, a reading without any is printed.

    Raises:
        UndecidedReading: lines of a reading are to be chosen; the sentence names the file.
    """
    from ..recording import read_recording
    from ..recording.source import reading_beside, reading_path

    recordings = []
    for path in paths or ():
        closed = output if output is not None and not os.access(Path(path).parent, os.W_OK) else None
        own = columns or (closed and reading_beside(path, closed))
        try:
            recordings.append(read_recording(path, robot, columns=own or None, unsigned=unsigned, rate=rate))
        except UndecidedReading as error:
            raise written_reading(error, reading_path(path, closed)) from None
        if not quiet:
            print_reading(recordings[-1].path, recordings[-1].reading)
    return recordings


def print_reading(path: str, reading: Reading | None) -> None:
    """Print a drafted reading, one line for each joint."""
    if reading is None or not reading.rows:
        return
    from ..output.report import Screen
    from ..output.report.layout import new_table

    table = new_table("joint", "columns", "units", "why", rows=reading.rows)
    Screen().print(f"Reading of {path}", table, "", sep="\n")


def written_reading(error: UndecidedReading, place: Path) -> UndecidedReading:
    """Write a reading that was drafted, into the log's folder or `-o`, and name its file in the sentence."""
    from ..output.report import write_files

    try:
        if error.text:  # else it lies there
            write_files(place.parent, {place.name: error.text}, named=True)
    except OutputError as fault:
        return UndecidedReading(f"{error}; the reading cannot be written: {fault}; add -o DIR", error.text)
    said = str(error).replace("its reading are", f"its reading, {readable(str(place))}, are", 1)
    return UndecidedReading(f"{said}; edit that file, which the next call reads", error.text)


def under_gravity(options: Given, paths: Iterable[str] | None, columns: str | None) -> Given:
    """Options of a robot with the gravity that the first reading states, unless --gravity does.

    Raises:
        RecordingError: a reading cannot be read.
    """
    from ..recording.mapping import read_map
    from ..recording.source import reading_beside

    files = (columns or reading_beside(path) for path in paths or ())
    gravity = next((stated for file in files if file and (stated := read_map(file).gravity)), None)
    return options if gravity is None or options.gravity else replace(options, gravity=",".join(map(str, gravity)))


def given_options(rows: RowOptions, seed: int, robust: bool = False) -> Options:
    """Return the options of the regression; `robust` down-weights outliers."""
    from ..regression.session import Options

    effects = given_effects(rows.effects)
    return Options(
        effects, rows.cutoff, rows.derivatives, not rows.no_instruments, not rows.white, robust=robust, seed=seed
    )


def given_effects(text: str | None) -> tuple[str, ...]:
    """Return the names of effects in a comma-separated list."""
    if text is None:
        return EFFECT_NAMES
    return () if text == "none" else _names("--effects", text)


def _names(option: str, text: str) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",")))
    if not all(names):
        raise OptionError(f"{option} {text!r} has an empty name; separate names by single commas")
    return names


def given_inputs(name: str, robot: Robot, actuators: str | None, **files: str | None) -> list[Input]:
    """List the description and the files read beside it, by role, with their digests; names are as given."""
    from ..recording.source import digest_of
    from ..types import Input

    beside = Path(robot.path).with_name("actuators.toml")
    folder = Path(name) if Path(name).is_dir() else Path(name).parent if Path(name).is_file() else Path(name)
    named = [(file, Path(file), role) for role, file in {"actuators": actuators, **files}.items() if file is not None]
    if actuators is None and beside.is_file():
        named.append((str(folder / beside.name), beside, "actuators"))
    read = (Input(readable(shown), digest_of(path), role) for shown, path, role in named)
    return [Input(readable(name), robot.sha256, "description"), *read]


def simulation_inputs(source: SimulationArguments, robot: Robot, **files: str | None) -> list[Input]:
    """List the simulation and the files read beside it, by role, with their digests."""
    from ..recording.source import digest_of
    from ..robot import saved_model
    from ..types import Input

    if (saved := saved_model(source.simulation)) is None:
        return given_inputs(source.simulation, robot, source.actuators, **files)
    read = {"model": (source.simulation, saved), **{role: (x, Path(x)) for role, x in files.items() if x is not None}}
    return [Input(readable(shown), digest_of(path), role) for role, (shown, path) in read.items()]


def has_drives(recordings: Sequence[Recording], forced: bool = False) -> bool:
    """Whether recordings have commanded positions and no torque, or commands at all if servo mode is `forced`.

    Raises:
        OptionError: servo mode is forced, and a recording has no commanded position.
    """
    for recording in recordings:
        if not any(recording.columns.get("q_des", ())):
            if forced:
                raise OptionError(
                    f"--servo needs commanded positions, and {recording.path or 'the recording'} has none; add columns "
                    f"q_des_J"
                )
            return False
    return forced or not any(any(recording.columns["tau"]) for recording in recordings)


def instead_of_torque(
    context: typer.Context, error: InputError, recordings: Sequence[Recording], done: str
) -> tuple[str, ...]:
    """Note that something is done for position drives, because no torque is usable and commands are recorded.

    Torque is unusable where torque constants of currents are unknown, and neither they nor lost signs can be found.

    Raises:
        InputError: the error, where torque constants are known, or a recording has no commands.
        OptionError: options that apply to torque were given.
    """
    unscaled = any(recording.scaled is not None for recording in recordings)
    if not unscaled or not all(any(recording.columns.get("q_des", ())) for recording in recordings):
        raise error
    if options := _given_options(context, TORQUE_OPTIONS):
        raise OptionError(f"{error}; or remove {options[0]} to have position drives {done} from q_des_J") from None
    return (f"position drives are {done} from q_des_J instead of torque: {error}",)


def check_options(context: typer.Context, drives: bool) -> None:
    """Reject options that do not apply to position drives, or to torque.

    Raises:
        OptionError: such an option was given.
    """
    drive_options = [item.name for item in fields(DriveOptions) if item.name != "servo"]
    for shown in _given_options(context, TORQUE_OPTIONS if drives else drive_options):
        if drives:
            raise OptionError(f"{shown} applies to torque, and these recordings have commands instead; leave it out")
        raise OptionError(f"{shown} applies to position drives, and the recordings have torque; add --servo")


def _given_options(context: typer.Context, names: Sequence[str]) -> list[str]:
    """Those of the options that were given with other values than their defaults, as they are written."""
    defaults = {parameter.name: parameter.default for parameter in context.command.params}
    options = [name for name in names if context.params.get(name) and context.params[name] != defaults[name]]
    return [f"--{name.replace('_', '-')}" for name in options]
