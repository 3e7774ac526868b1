"""The command `convert`."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...errors import OptionError
from ..app import Text, Texts, bounded, command, complete_robot, option, output_option
from ..arguments import given_inputs, given_robot
from ..options import Columns, Json, Rate, RobotOptions
from ..terminal import check_file, show, write_columns

if TYPE_CHECKING:
    from ...recording.joining import Files
    from ...recording.names.mapping import Heading
    from ...types import Robot


@dataclass(frozen=True, kw_only=True)
class ConvertOptions:
    """How a log is read, and where the recording is written."""

    output: Text = output_option("The recording: .csv, .csv.gz, .parquet or .npz. Default: none.", "FILE")
    topic: Texts = option(None, "Topic of a bag; several are joined in time. Repeatable.", metavar="NAME")
    columns: Columns = None
    rate: Rate = None
    map: Text = option(
        None, "Column map: used if the file exists, else written for --robot. Default: none.", metavar="FILE"
    )
    unit: Texts = option(None, "Unit of the columns of a kind: q=deg, t=ns. Repeatable.", metavar="KIND=UNIT")
    skip: int | None = option(None, "Lines before the header of a text table. Default: found.", metavar="N", min=0)
    names: Text = option(
        None,
        "Names of all columns of a table without a header; an empty one is not used. Default: none.",
        metavar="t,q_1,...",
    )
    calibration: Text = option(
        None, "Calibration of LeRobot: ranges of motors, for a --map that is written. Default: none.", metavar="FILE"
    )
    drop_missing: bool = option(False, "Leave out rows that lack a position or torque.", "--drop-missing")
    offset: Texts = option(
        None, "Seconds added to the times of one of several files. Default: by the data. Repeatable.", metavar="FILE=S"
    )
    align: bool = option(False, "Remove offsets of clocks that overlap, as the data show them.", "--align")
    robot: Text = option(
        None, "Compare column names with its joints. Default: none.", metavar="ROBOT", autocompletion=complete_robot
    )


@command("signid convert log.csv --robot 3r --map map.toml -o recording.csv")
def convert(
    sources: Annotated[
        list[str], typer.Argument(metavar="BAG_OR_TABLE", help="ROS bag, MCAP, LeRobot dataset or table.")
    ],
    conversion: ConvertOptions,
    robot_options: RobotOptions,
    json: Json = False,
) -> int:
    """Convert a log or a table to a recording, and summarise it.

    Topics are joined in time; units and column names become those of recordings. A log with other names and units takes
    two steps: --robot with a --map that does not exist writes a complete column map, guessed from names and numbers.
    Read and correct it; the same command then uses it. With --robot alone, names that match no joint are listed.
    Several files, one a joint or a quantity, are joined on time: elbow.csv with t, position and torque gives q_elbow.
    """
    from ...output.report import document, tables, to_json
    from ...recording.convert import convert as read

    name, output = conversion.robot, conversion.output
    _check(sources, conversion, robot_options.actuators, json)
    files = _files(sources, conversion)
    robot = given_robot(name, robot_options) if name is not None else None
    columns = _column_map(sources, conversion)
    if robot is not None and conversion.map is not None and not Path(conversion.map).exists():
        return _write_map(files, conversion.map, robot, conversion, json)
    found = read(
        files,
        columns=columns,
        heading=_heading(conversion),
        units=_units(conversion.unit or ()),
        topics=conversion.topic or (),
        robot=robot,
        drop_missing=conversion.drop_missing,
    )
    inputs = [] if name is None or robot is None else given_inputs(name, robot, robot_options.actuators)
    text = to_json(document(found, inputs))
    written = write_columns(output, found.columns)
    return show(text if json else tables(found), found.flags, written)


def _check(sources: list[str], conversion: ConvertOptions, actuators: str | None, json: bool) -> None:
    """Check that the result can be written."""
    output = conversion.output
    if output is not None:
        check_file(output, json, [conversion.columns, conversion.map, conversion.robot, actuators])
        if Path(output).resolve() in [Path(source).resolve() for source in sources]:
            raise OptionError(f"-o {output} is the file to convert; give the result another name")


def _column_map(sources: list[str], conversion: ConvertOptions) -> str | None:
    """File of the column map, or of the reading beside the log; a --map that does not exist is to be written.

    Raises:
        OptionError: two maps, no robot for a map that is to be written, or a calibration without such a map.
    """
    from ...recording.source import reading_beside

    if conversion.calibration is not None and (conversion.map is None or Path(conversion.map).exists()):
        raise OptionError("--calibration is for a column map that is written; add --robot and a --map that is new")
    if conversion.map is None:
        beside = reading_beside(sources[0]) if len(sources) == 1 else None
        return conversion.columns or (str(beside) if beside else None)
    if conversion.columns is not None:
        raise OptionError("--map and --columns both name a column map; give one of them")
    if not conversion.map or Path(conversion.map).is_dir():
        raise OptionError(f"--map {conversion.map!r} is not a file name; give the path of a TOML file")
    if conversion.robot is None and not Path(conversion.map).exists():
        raise OptionError(f"--map {conversion.map} does not exist; add --robot ROBOT to write it, or correct its name")
    return conversion.map


def _write_map(files: Files, file: str, robot: Robot, conversion: ConvertOptions, json: bool) -> int:
    """Write a drafted column map, and print it and the next command."""
    from ...output.report import check_regular, probe_folder, to_json, write_files
    from ...output.report.results.recordings import map_document, map_text
    from ...recording.names.mapping import read_calibration
    from ...recording.reading import draft_map

    probe_folder(Path(file).parent, "--map")
    check_regular(file)
    ranges = None if conversion.calibration is None else read_calibration(conversion.calibration)
    drafted = draft_map(files, robot, conversion.topic or (), _heading(conversion), ranges)
    write_files(Path(file).parent, {Path(file).name: drafted.text}, "--map", named=True)
    again = ["signid", "convert", *map(str, files.paths), "--robot", str(conversion.robot), "--map", file]
    again += [word for topic in conversion.topic or () for word in ("--topic", topic)]
    again += [word for offset in conversion.offset or () for word in ("--offset", offset)]
    again += ["--align"] if conversion.align else []
    again += ["-o", conversion.output or "recording.csv"]
    shown = to_json(map_document(drafted, robot, file)) if json else map_text(drafted, file, shlex.join(again))
    return show(shown, drafted.lacking)


def _files(sources: list[str], conversion: ConvertOptions) -> Files:
    """Files to convert, and the offsets of their clocks."""
    from ...recording.joining import Files

    offsets: dict[str, float] = {}
    for text in conversion.offset or ():
        file, _, number = text.rpartition("=")
        try:
            seconds = float(number)
        except ValueError:
            seconds = float("nan")
        if not file or not isfinite(seconds):
            raise OptionError(f"--offset {text!r} is not a file and seconds; write --offset {file or sources[-1]}=1.25")
        if file in offsets:
            raise OptionError(f"--offset gives {file} twice; give one offset for it")
        offsets[file] = bounded("--offset", seconds)
    return Files(tuple(sources), offsets, conversion.align)


def _heading(conversion: ConvertOptions) -> Heading:
    """Lines and names that the file does not state itself; a drafted column map keeps them."""
    from ...recording.names.mapping import read_heading

    names = () if conversion.names is None else conversion.names.split(",")
    name = "--names" if conversion.skip is None else "--skip, --names"
    return read_heading(name, conversion.skip or 0, names, conversion.rate)


def _units(texts: list[str] | tuple[()]) -> dict[str, str]:
    """Units by kind of column."""
    from ...recording.names.vocabulary import OF

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
