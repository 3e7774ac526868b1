"""The commands `convert`, of recordings, and `export`, of models."""

from __future__ import annotations

import shlex
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...errors import OptionError
from ..app import Text, Texts, command, option, output_option
from ..arguments import given_inputs, given_model, given_robot, simulation_inputs
from ..completion import complete_robot
from ..options import Columns, Json, PackageDir, RobotOptions, SimulationArguments, SimulationName
from ..terminal import DONE, check_file, check_unread, show, write_columns

if TYPE_CHECKING:
    from ...output.export import Exported
    from ...types import Robot


@dataclass(frozen=True, kw_only=True)
class ConvertOptions:
    """How a log is read, and where the recording is written."""

    output: Text = output_option("The recording: .csv, .csv.gz, .parquet or .npz. Default: none.", "FILE")
    topic: Texts = option(None, "Topic of a bag; several are joined in time. Repeatable.", metavar="NAME")
    columns: Columns = None
    map: Text = option(
        None, "Column map: used if the file exists, else written for --robot. Default: none.", metavar="FILE"
    )
    unit: Texts = option(None, "Unit of the columns of a kind: q=deg, t=ns. Repeatable.", metavar="KIND=UNIT")
    drop_missing: bool = option(False, "Leave out rows that lack a position or torque.", "--drop-missing")
    robot: Text = option(
        None, "Compare column names with its joints. Default: none.", metavar="ROBOT", autocompletion=complete_robot
    )


@command("signid convert log.csv --robot 3r --map map.toml -o recording.csv")
def convert(
    source: Annotated[str, typer.Argument(metavar="BAG_OR_TABLE", help="ROS bag, MCAP, LeRobot, CSV, Parquet or NPZ.")],
    conversion: ConvertOptions,
    robot_options: RobotOptions,
    json: Json = False,
) -> int:
    """Convert a log or a table to a recording, and summarise it.

    Topics are joined in time; units and column names become those of recordings. A log with other names and units takes
    two steps: --robot with a --map that does not exist writes a complete column map, guessed from names and numbers.
    Read and correct it; the same command then uses it. With --robot alone, names that match no joint are listed.
    """
    from ...output.report import conversion_document, conversion_tables, to_json
    from ...recording.convert import convert as read

    name, output = conversion.robot, conversion.output
    _check(source, conversion, robot_options.actuators, json)
    robot = given_robot(name, robot_options) if name is not None else None
    columns = _column_map(conversion)
    if robot is not None and conversion.map is not None and not Path(conversion.map).exists():
        return _write_map(source, conversion.map, robot, conversion, json)
    found = read(
        source,
        columns=columns,
        units=_units(conversion.unit or ()),
        topics=conversion.topic or (),
        robot=robot,
        drop_missing=conversion.drop_missing,
    )
    inputs = [] if name is None or robot is None else given_inputs(name, robot, robot_options.actuators)
    document = to_json(conversion_document(found, inputs))
    written = write_columns(output, found.columns)
    return show(document if json else conversion_tables(found), found.flags, written)


def _check(source: str, conversion: ConvertOptions, actuators: str | None, json: bool) -> None:
    """Check that the result can be written."""
    output = conversion.output
    if output is not None:
        check_file(output, json, [conversion.columns, conversion.map, conversion.robot, actuators])
        if Path(output).resolve() == Path(source).resolve():
            raise OptionError(f"-o {output} is the file to convert; give the result another name")


def _column_map(conversion: ConvertOptions) -> str | None:
    """File of the column map; a --map that does not exist is to be written.

    Raises:
        OptionError: two maps, or no robot for a map that is to be written.
    """
    if conversion.map is None:
        return conversion.columns
    if conversion.columns is not None:
        raise OptionError("--map and --columns both name a column map; give one of them")
    if not conversion.map or Path(conversion.map).is_dir():
        raise OptionError(f"--map {conversion.map!r} is not a file name; give the path of a TOML file")
    if conversion.robot is None and not Path(conversion.map).exists():
        raise OptionError(f"--map {conversion.map} does not exist; add --robot ROBOT to write it, or correct its name")
    return conversion.map


def _write_map(source: str, file: str, robot: Robot, conversion: ConvertOptions, json: bool) -> int:
    """Write a drafted column map, and print it and the next command."""
    from ...output.report import probe_folder, to_json, write_files
    from ...output.report.results.recordings import map_document, map_text
    from ...recording.draft import draft_map

    probe_folder(Path(file).parent, "--map")
    drafted = draft_map(source, robot, conversion.topic or ())
    write_files(Path(file).parent, {Path(file).name: drafted.text}, "--map", named=True)
    again = ["signid", "convert", source, "--robot", str(conversion.robot), "--map", file]
    again += [word for topic in conversion.topic or () for word in ("--topic", topic)]
    again += ["-o", conversion.output or "recording.csv"]
    shown = to_json(map_document(drafted, robot, file)) if json else map_text(drafted, file, shlex.join(again))
    return show(shown, drafted.lacking)


def _units(texts: list[str] | tuple[()]) -> dict[str, str]:
    """Units by kind of column."""
    from ...recording.mapping import OF

    units: dict[str, str] = {}
    for text in texts:
        kind, _, unit = (part.strip() for part in text.partition("="))
        if kind not in OF or not unit:
            kinds = ", ".join(OF)
            raise OptionError(f"--unit {text!r} is not a kind of column and its unit; write q=deg, one of {kinds}")
        if kind in units:
            raise OptionError(f"--unit gives {kind} twice; give one unit for it")
        units[kind] = unit
    return units


@dataclass(frozen=True, kw_only=True)
class ExportFiles:
    """Files to write, by format."""

    urdf: Text = option(None, "The robot's URDF with the model's inertials.", metavar="FILE")
    mjcf: Text = option(None, "MuJoCo model with every law that MJCF can hold.", metavar="FILE")
    actuators: Text = option(None, "TOML of the actuators, for use with a URDF.", metavar="FILE")
    function: Text = option(None, "Python: torque(q, v, a) of the laws.", metavar="FILE")
    ros: Text = option(None, "YAML: actuators and inertials for a ROS 2 node.", metavar="FILE")
    isaaclab: Text = option(None, "Python: actuators for Isaac Lab.", metavar="FILE")
    mjlab: Text = option(None, "Python: actuators for mjlab.", metavar="FILE")
    lerobot: Text = option(None, "JSON: position drives by motor, for LeRobot.", metavar="FILE")
    expected: Text = option(None, "Python without packages: positions expected from commands.", metavar="FILE")
    c: Text = option(None, "C99: inverse dynamics; FILE.h and FILE_test.c beside it.", "--c", metavar="FILE.c")
    arrays: Text = option(None, "Python: inverse dynamics over numpy, jax.numpy or torch.", metavar="FILE")


@command("signid export result/model.json --urdf arm.urdf --mjcf arm.xml")
def export(simulation: SimulationName, exports: ExportFiles, package_dir: PackageDir = None, json: Json = False) -> int:
    """Write a model in the file formats of other programs.

    Options can be combined; content that a format cannot hold is listed. The URDF gets inertials (including a payload),
    damping and friction, and is otherwise unchanged. The MJCF also gets armature, springs, gravity, ranges and motors,
    or position drives with their delay and limits. --function needs only NumPy and holds the laws that both lack.
    """
    from ...output.export import export as write
    from ...output.report import Screen, to_json
    from ...output.report.results.documents import provenance

    asked: dict[str, Text] = asdict(exports)
    paths = {kind: Path(file) for kind, file in asked.items() if file is not None}
    _check_exports(asked, paths)
    packages = None if simulation.endswith(".json") else package_dir
    source = SimulationArguments(simulation=simulation, package_dir=packages)
    model, _ = given_model(source)
    for kind, path in paths.items():
        check_unread(path, [simulation, model.robot.path], f"--{kind}")
    made = {kind: write(model, kind, package_dir or (), name=path.stem) for kind, path in paths.items()}
    _write(paths, made)
    files = [{"kind": kind, "path": asked[kind], "notes": list(made[kind].notes)} for kind in paths]
    known = {"schema": "signid.export/1", "robot": model.robot.name, "files": files}
    screen = Screen()
    if json:
        screen.write(to_json({**known, **provenance((), simulation_inputs(source, model.robot), 0)}))
        return DONE
    for kind in paths:
        for note in made[kind].notes:
            screen.print(f"{kind}: {note}")
    beside = [path.with_name(path.stem + end) for kind, path in paths.items() for end in made[kind].beside]
    screen.write("\n".join(["written:", *(f"  {path}" for path in (*paths.values(), *beside)), ""]))
    return DONE


def _check_exports(asked: dict[str, Text], paths: dict[str, Path]) -> None:
    """Check that the files can be written."""
    from ...output.report import probe_folder

    if not paths:
        raise OptionError(f"no file was named; add {', '.join(f'--{kind}' for kind in asked)} FILE")
    for kind, path in paths.items():
        if not asked[kind] or path.is_dir():
            raise OptionError(f"--{kind} {asked[kind]!r} is not a file name; give the path of the file to write")
        if kind == "c" and (path.suffix != ".c" or not path.stem.isidentifier()):
            raise OptionError(f"--c {asked[kind]!r} is no name of a C file; give one such as arm.c, without spaces")
        probe_folder(path.parent, f"--{kind}")
    if len({path.resolve() for path in paths.values()}) < len(paths):
        raise OptionError("two of the files have the same name; give each its own")


def _write(paths: dict[str, Path], made: dict[str, Exported]) -> None:
    """Write the files; those of one folder all or none."""
    from ...output.report import check_foreign, write_files

    beside = {kind: [path.with_name(path.stem + end) for end in made[kind].beside] for kind, path in paths.items()}
    for kind, further in beside.items():
        check_foreign(paths[kind].parent, [path.name for path in further], f"--{kind}")
        if shared := {path.resolve() for path in further} & {path.resolve() for path in paths.values()}:
            raise OptionError(f"--{kind} also writes {shared.pop().name}; give the other file another name")
    for folder in dict.fromkeys(path.parent for path in paths.values()):
        mine = {kind: path for kind, path in paths.items() if path.parent == folder}
        texts = {path.name: made[kind].text for kind, path in mine.items()}
        texts |= {path.stem + end: x for kind, path in mine.items() for end, x in made[kind].beside.items()}
        write_files(folder, texts, f"--{next(iter(mine))}", named=True)
