"""Answers of check, identify and diagnose to senseless recordings of the 3r."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from rich.table import Table

import signid
from signid.check import check
from signid.model import Model
from signid.types import Recording, Robot

from .senseless import Columns, senseless

ROBOT = Path(__file__).parents[2] / "robots" / "3r"
COMMANDS = ("check", "identify", "diagnose")


class Said(NamedTuple):
    """Exit codes of the three commands for a recording, and the first sentence."""

    name: str
    codes: tuple[int, ...]  # 0 silent, 2 refused, 3 flagged
    sentence: str


def answers() -> Iterator[Said]:
    """Yield the answers for the good recording, and for each senseless one."""
    robot, model = signid.load_robot("3r"), signid.load_model("3r")
    rows, other = (signid.read_recording(ROBOT / f"{name}.parquet", robot).read() for name in ("recording", "held_out"))
    made: dict[str, Columns] = {"good": {"t": rows.t, "q": rows.q, "tau": rows.tau}}
    for name, columns in (made | senseless(rows.t, rows.q, rows.tau, other.tau)).items():
        results = [_answer(command, robot, model, columns) for command in COMMANDS]
        sentence = next((flags[0] for _, flags in results if flags), "")
        yield Said(name, tuple(code for code, _ in results), sentence)


def _answer(command: str, robot: Robot, model: Model, columns: Columns) -> tuple[int, tuple[str, ...]]:
    """Exit code and flags."""
    runs: dict[str, Callable[[Recording], tuple[str, ...]]] = {
        "check": lambda recording: check(robot, [recording]).flags,
        "identify": lambda recording: signid.identify(robot, [recording]).flags,
        "diagnose": lambda recording: tuple(signid.diagnose(model, [recording]).flags),
    }
    try:
        flags = runs[command](signid.read_recording(columns, robot))
    except ValueError as error:
        return 2, (str(error),)
    return (3 if flags else 0), flags


def show(found: list[Said]) -> Table:
    """Table of exit codes and first sentences."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    for head in ("recording", *COMMANDS, "first sentence"):
        table.add_column(head, no_wrap=True)
    for said in found:
        table.add_row(said.name, *map(str, said.codes), said.sentence[:100])
    return table
