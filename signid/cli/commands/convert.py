"""The command `convert`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ...errors import OptionError
from ..app import app
from ..arguments import Actuators, Columns, Joints, Json, Lock, given_inputs, given_robot
from ..output import check_file, write_columns
from ..terminal import tell_flags


@app.command(epilog="Example: signid convert bag --topic /joint_states -o recording.csv")
def convert(
    source: Annotated[str, typer.Argument(metavar="BAG_OR_TABLE", help="ROS bag, MCAP, LeRobot, CSV, Parquet or NPZ.")],
    output: Annotated[
        str | None,
        typer.Option("--output", "-o", metavar="FILE", help=".csv, .csv.gz, .parquet or .npz. Default: look only."),
    ] = None,
    topic: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Of a bag; several are joined in time. Repeatable.")
    ] = None,
    columns: Columns = None,
    unit: Annotated[
        list[str] | None, typer.Option(metavar="KIND=UNIT", help="What columns are in: q=deg, t=ns. Repeatable.")
    ] = None,
    drop_missing: Annotated[
        bool, typer.Option("--drop-missing", help="Leave out rows that lack a position or torque.")
    ] = False,
    robot: Annotated[
        str | None, typer.Option(metavar="ROBOT", help="Hold names against its joints. Default: none.")
    ] = None,
    joints: Joints = None,
    lock: Lock = None,
    actuators: Actuators = None,
    json: Json = False,
) -> int:
    """A log or a table as a recording, and what was read of it.

    Topics are joined in time, units and names made those of recordings. With --robot, names that do not fit are told
    with a column map that may; nothing is taken from it unasked.
    """
    from ...output.report import Screen, conversion_document, conversion_tables, to_json
    from ...recording.convert import convert as read

    _check(source, output, json)
    described = given_robot(robot, joints, lock, actuators, None) if robot is not None else None
    found = read(
        source,
        columns=columns,
        units=_units(unit or ()),
        topics=topic or (),
        robot=described,
        drop_missing=drop_missing,
    )
    inputs = given_inputs(robot, described, actuators) if robot is not None and described is not None else []
    document = to_json(conversion_document(found, inputs))
    written, screen = write_columns(output, found.columns), Screen()
    if json:
        screen.write(document)
        return tell_flags(found.flags)
    screen.print(*conversion_tables(found), sep="\n")
    code = tell_flags(found.flags)
    screen.write("\n".join(["", "written:", *(f"  {path}" for path in written), ""]) if written else "")
    return code


def _check(source: str, output: str | None, json: bool) -> None:
    """Find out at once whether the result can be written."""
    if output is None:
        return
    check_file(output, json)
    if Path(output).resolve() == Path(source).resolve():
        raise OptionError(f"-o {output} is what is to be converted; give the result another name")


def _units(texts: list[str] | tuple[()]) -> dict[str, str]:
    """Units by kind of column."""
    from ...recording.units import OF

    units: dict[str, str] = {}
    for text in texts:
        kind, _, unit = (part.strip() for part in text.partition("="))
        if kind not in OF or not unit:
            raise OptionError(f"--unit {text!r} is no kind of column and its unit; write q=deg, one of {', '.join(OF)}")
        if kind in units:
            raise OptionError(f"--unit gives {kind} twice; give one unit for it")
        units[kind] = unit
    return units
