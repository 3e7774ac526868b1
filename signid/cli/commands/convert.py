"""The command `convert`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ...errors import OptionError
from ..app import app
from ..arguments import given_inputs, given_robot
from ..options import Columns, Json, RobotOptions, Texts, expanded
from ..output import check_file, list_written, write_columns
from ..terminal import write_flags


@dataclass(frozen=True, kw_only=True)
class ConvertOptions:
    """How a log is read, and where the recording is written."""

    output: Annotated[
        str | None,
        typer.Option(
            "--output", "-o", metavar="FILE", help="The recording: .csv, .csv.gz, .parquet or .npz. Default: none."
        ),
    ] = None
    topic: Annotated[
        Texts, typer.Option(metavar="NAME", help="Topic of a bag; several are joined in time. Repeatable.")
    ] = None
    columns: Columns = None
    unit: Annotated[
        Texts, typer.Option(metavar="KIND=UNIT", help="Unit of the columns of a kind: q=deg, t=ns. Repeatable.")
    ] = None
    drop_missing: Annotated[
        bool, typer.Option("--drop-missing", help="Leave out rows that lack a position or torque.")
    ] = False
    robot: Annotated[
        str | None, typer.Option(metavar="ROBOT", help="Compare column names with its joints. Default: none.")
    ] = None


@app.command(epilog="Example: signid convert bag --topic /joint_states -o recording.csv")
@expanded
def convert(
    source: Annotated[str, typer.Argument(metavar="BAG_OR_TABLE", help="ROS bag, MCAP, LeRobot, CSV, Parquet or NPZ.")],
    conversion: ConvertOptions,
    robot_options: RobotOptions,
    json: Json = False,
) -> int:
    """Convert a log or a table to a recording, and summarise it.

    Topics are joined in time; units and column names become those of recordings. With --robot, names that match no
    joint are listed with a column map that may fit; the map is not applied by itself.
    """
    from ...output.report import Screen, conversion_document, conversion_tables, to_json
    from ...recording.convert import convert as read

    name, output = conversion.robot, conversion.output
    _check(source, output, json)
    robot = given_robot(name, robot_options) if name is not None else None
    found = read(
        source,
        columns=conversion.columns,
        units=_units(conversion.unit or ()),
        topics=conversion.topic or (),
        robot=robot,
        drop_missing=conversion.drop_missing,
    )
    inputs = [] if name is None or robot is None else given_inputs(name, robot, robot_options.actuators)
    document = to_json(conversion_document(found, inputs))
    written = write_columns(output, found.columns)
    if json:
        Screen().write(document)
        return write_flags(found.flags)
    Screen().print(*conversion_tables(found), sep="\n")
    code = write_flags(found.flags)
    list_written(written)
    return code


def _check(source: str, output: str | None, json: bool) -> None:
    """Check that the result can be written."""
    if output is None:
        return
    check_file(output, json)
    if Path(output).resolve() == Path(source).resolve():
        raise OptionError(f"-o {output} is the file to convert; give the result another name")


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
