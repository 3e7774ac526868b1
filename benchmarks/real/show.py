"""Rows as tables to read."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.table import Table

from .repeat import Agreement, Repeat
from .row import Row

TOLD = 6  # findings of one diagnosis


def show_rows(rows: Sequence[Row]) -> Table:
    """What was concealed, what was said."""
    table = _frame("what was said", ("robot", "concealed", "verdict", "found", "P", "numbers", "CPU s"))
    for row in rows:
        for k, said in enumerate(row.findings[:TOLD] or (None,)):
            head = (row.robot, row.concealed, row.verdict) if k == 0 else ("", "", "")
            told = ("nothing", "", "") if said is None else (said.place, f"{said.probability:.3f}", said.numbers)
            table.add_row(*head, *told, f"{row.seconds:.1f}" if k == 0 else "", style="dim" if k else "")
        if len(row.findings) > TOLD:
            table.add_row("", "", "", f"and {len(row.findings) - TOLD} more", "", "", "", style="dim")
    return table


def show_targets(rows: Sequence[Row]) -> Table:
    """What was asked for."""
    table = _frame("targets", ("robot", "concealed", "what", "said", "asked", ""))
    for row in rows:
        for target in row.targets:
            met = "" if target.met is None else "met" if target.met else "NOT MET"
            style = "red" if target.met is False else ""
            table.add_row(row.robot, row.concealed, target.what, target.value, target.asked, met, style=style)
        if row.verdict == "refused":
            table.add_row(row.robot, row.concealed, "refused", row.flags[0], "", "" if row.targets else "NOT MET")
    return table


def show_left(rows: Sequence[Row]) -> Table:
    """What stays unexplained."""
    table = _frame("what stays", ("robot", "concealed", "joint", "held out / floor", "share of torque", "depends on"))
    for row in rows:
        for joint, ratio in row.left.items():
            share, place = row.unexplained.get(joint, (float("nan"), ""))
            told = "" if share != share else f"{100 * share:.1f} %"
            table.add_row(row.robot, row.concealed, joint, f"{ratio:.2f}", told, place)
    return table


def show_repeats(groups: Sequence[Sequence[Repeat]], agreements: Sequence[Agreement]) -> Table:
    """The same robot, recording by recording."""
    table = _frame("one by one", ("robot", "concealed", "recording", "first", "P", "numbers", "CPU s", ""))
    for rows, told in zip(groups, agreements, strict=True):
        for row in rows:
            numbers = ", ".join(f"{key} {x[0]:.3g} ± {x[1]:.2g}" for key, x in row.watched.items() if x)
            cells = (row.robot, row.concealed, row.recording, row.first, f"{row.probability:.3f}", numbers)
            table.add_row(*cells, f"{row.seconds:.1f}", "")
        apart = ", ".join(key for key, yes in told.within.items() if yes is False)
        said = f"first: {'same' if told.same_first else 'NOT the same'}; apart: {apart or 'none'}"
        table.add_row(
            "", "", "", said, "", "", "", "met" if told.holds else "NOT MET", style="" if told.holds else "red"
        )
    return table


def _frame(title: str, names: Sequence[str]) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True, title=title)
    for name in names:
        table.add_column(name, overflow="fold")
    return table
