"""The command `convert`."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...errors import OptionError, RecordingError, UndecidedReading
from ..app import (
    Columns,
    Json,
    Rate,
    RobotOptions,
    Text,
    Texts,
    bounded,
    command,
    complete_robot,
    option,
    output_option,
)
from ..arguments import given_inputs, given_robot, print_reading, written_reading
from ..terminal import check_file

if TYPE_CHECKING:
    from ...recording.convert import Conversion
    from ...recording.joining import Files
    from ...recording.mapping import ColumnMap


@dataclass(frozen=True, kw_only=True)
class ConvertOptions:
    """How a log is read, and where the recording is written."""

    output: Text = output_option("The recording: .csv, .csv.gz, .parquet or .npz. Default: none.", "FILE")
    topic: Texts = option(None, "Topic of a bag; several are joined in time. Repeatable.", metavar="NAME")
    columns: Columns = None
    rate: Rate = None
    unit: Texts = option(None, "Unit of the columns of a kind: q=deg, t=ns. Repeatable.", metavar="KIND=UNIT")
    skip: int | None = option(None, "Lines before the header of a text table. Default: found.", metavar="N", min=0)
    names: Text = option(
        None,
        "Names of all columns of a table without a header; an empty one is not used. Default: none.",
        metavar="t,q_1,...",
    )
    calibration: Text = option(
        None, "Calibration of LeRobot: ranges of motors, for a drafted reading. Default: none.", metavar="FILE"
    )
    drop_missing: bool = option(False, "Leave out rows that lack a position or torque.", "--drop-missing")
    offset: Texts = option(
        None, "Seconds added to the times of one of several files. Default: by the data. Repeatable.", metavar="FILE=S"
    )
    align: bool = option(False, "Remove offsets of clocks that overlap, as the data show them.", "--align")
    robot: Text = option(
        None, "Read the columns for its joints. Default: none.", metavar="ROBOT", autocompletion=complete_robot
    )


@command("signid convert log.csv --robot 3r -o recording.csv")
def convert(
    sources: Annotated[
        list[str], typer.Argument(metavar="BAG_OR_TABLE", help="ROS bag, MCAP, LeRobot dataset or table.")
    ],
    conversion: ConvertOptions,
    robot_options: RobotOptions,
    json: Json = False,
) -> int:
    """Convert a log or a table to a recording, and summarise it.

    Topics are joined in time; units and column names become those of recordings. With --robot, a log with other names
    and units is read by LOG.reading.toml beside it, else by a reading that is drafted from names and numbers; if lines
    of it are to be chosen, it is written there. Correct it; the same command then uses it.

    Several files, one a joint or a quantity, are joined on time: elbow.csv with t, position and torque gives q_elbow.

    Raises:
        OptionError: the result has the name of a file to convert, or no reading is drafted with the calibration.
    """
    from ...recording.convert import convert as read
    from ...recording.mapping import read_calibration, read_heading
    from ...recording.reading import draft_reading
    from ...recording.source import reading_beside, reading_path
    from ..terminal import deliver

    name, output = conversion.robot, conversion.output
    if output is not None:
        check_file(output, json, [conversion.columns, name, robot_options.actuators])
        if Path(output).resolve() in [Path(source).resolve() for source in sources]:
            raise OptionError(f"-o {output} is the file to convert; give the result another name")
    files = _files(sources, conversion)
    robot = given_robot(name, robot_options) if name is not None else None
    ranges = None if conversion.calibration is None else read_calibration(conversion.calibration)
    columns = conversion.columns or reading_beside(sources[0])
    names = () if conversion.names is None else conversion.names.split(",")
    options = "--names" if conversion.skip is None else "--skip, --names"
    heading = read_heading(options, conversion.skip or 0, names, conversion.rate)
    if ranges is not None and (robot is None or columns is not None):
        raise OptionError("--calibration is for a reading that is drafted; add --robot, and leave --columns out")

    def converted(columns: ColumnMap | None) -> Conversion:
        from ...recording.vocabulary import OF

        units: dict[str, str] = {}
        for text in conversion.unit or ():
            kind, _, unit = (part.strip() for part in text.partition("="))
            if kind not in OF or not unit:
                kinds = ", ".join(OF)
                raise OptionError(f"--unit {text!r} is not a kind of column and its unit; write q=deg, one of {kinds}")
            if kind in units:
                raise OptionError(f"--unit gives {kind} twice; give one unit for it")
            units[kind] = unit
        return read(
            files,
            columns=columns,
            heading=heading,
            units=units,
            topics=conversion.topic or (),
            robot=robot,
            drop_missing=conversion.drop_missing,
        )

    found = converted(columns)
    if robot is not None and columns is None and (found.unread or ranges is not None):
        fault = RecordingError(found.unread)
        try:
            reading = draft_reading(files, robot, conversion.topic or (), fault, heading, ranges or {})
        except UndecidedReading as error:
            raise written_reading(error, reading_path(sources[0])) from None
        except RecordingError:
            pass  # no other names: flagged
        else:
            found = converted(tomllib.loads(reading.text))
            if not json:
                print_reading(" + ".join(sources), reading)
    inputs = [] if name is None or robot is None else given_inputs(name, robot, robot_options.actuators)
    return deliver(found, inputs, output, json, columns=found.columns)


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
