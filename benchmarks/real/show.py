"""Tables of the rows."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.table import Table

from .repeat import Agreement, Repeat
from .row import Row

SHOWN = 6  # largest number of displayed findings per diagnosis


def show_rows(rows: Sequence[Row]) -> Table:
    """Table of concealed physics and findings."""
    table = _frame("findings", ("robot", "concealed", "verdict", "found", "P", "numbers", "CPU s"))
    for row in rows:
        for k, finding in enumerate(row.findings[:SHOWN] or (None,)):
            head = (row.robot, row.concealed, row.verdict) if k == 0 else ("", "", "")
            cells = ("nothing", "", "")
            if finding is not None:
                cells = (finding.place, f"{finding.probability:.3f}", finding.numbers)
            table.add_row(*head, *cells, f"{row.seconds:.1f}" if k == 0 else "", style="dim" if k else "")
        if len(row.findings) > SHOWN:
            table.add_row("", "", "", f"and {len(row.findings) - SHOWN} more", "", "", "", style="dim")
    return table


def show_targets(rows: Sequence[Row]) -> Table:
    """Table of targets."""
    table = _frame("targets", ("robot", "concealed", "figure", "result", "target", ""))
    for row in rows:
        for target in row.targets:
            met = "" if target.met is None else "met" if target.met else "NOT MET"
            style = "red" if target.met is False else ""
            table.add_row(row.robot, row.concealed, target.what, target.value, target.asked, met, style=style)
        if row.verdict == "refused":
            table.add_row(row.robot, row.concealed, "refused", row.flags[0], "", "" if row.targets else "NOT MET")
    return table


def show_left(rows: Sequence[Row]) -> Table:
    """Table of unexplained residuals."""
    table = _frame(
        "unexplained residual", ("robot", "concealed", "joint", "held out / floor", "share of torque", "depends on")
    )
    for row in rows:
        for joint, ratio in row.left.items():
            share, place = row.unexplained.get(joint, (float("nan"), ""))
            percent = "" if share != share else f"{100 * share:.1f} %"
            table.add_row(row.robot, row.concealed, joint, f"{ratio:.2f}", percent, place)
    return table


def show_repeats(groups: Sequence[Sequence[Repeat]], agreements: Sequence[Agreement]) -> Table:
    """Table of the diagnoses of one robot, recording by recording."""
    table = _frame("one by one", ("robot", "concealed", "recording", "first", "P", "numbers", "CPU s", ""))
    for rows, agreement in zip(groups, agreements, strict=True):
        for row in rows:
            numbers = ", ".join(f"{key} {x[0]:.3g} ± {x[1]:.2g}" for key, x in row.watched.items() if x)
            cells = (row.robot, row.concealed, row.recording, row.first, f"{row.probability:.3f}", numbers)
            table.add_row(*cells, f"{row.seconds:.1f}", "")
        apart = ", ".join(key for key, yes in agreement.within.items() if yes is False)
        summary = f"first: {'same' if agreement.same_first else 'NOT the same'}; apart: {apart or 'none'}"
        table.add_row(
            "",
            "",
            "",
            summary,
            "",
            "",
            "",
            "met" if agreement.holds else "NOT MET",
            style="" if agreement.holds else "red",
        )
    return table


def _frame(title: str, names: Sequence[str]) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True, title=title)
    for name in names:
        table.add_column(name, overflow="fold")
    return table
