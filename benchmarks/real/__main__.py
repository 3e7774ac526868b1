"""Diagnosis of known missing physics on real robots: `python -m benchmarks.real [--only CASE ...] [--json FILE]`.

Needs SIGNID_DATA. Simulations without a known property of the robot are compared with its recordings: the payload of a
UR10e, the coupled wrist of a TX40, the asymmetric friction of the EMPS, the friction of a Panda and a hand that it does
not carry, the speed dependence of the UR10e's friction, and an LWR4+ with insufficient excitation. `repeat` diagnoses
the recordings of one robot one by one. Exits with 1 when a target is missed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from ..summary import command_line, data, one_thread, write_json
from . import cases, repeat
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


CASES: dict[str, Callable[[], Iterator[Row]]] = {
    "ur10e": cases.payload,
    "jointwise": cases.jointwise,
    "tx40": cases.tx40,
    "emps": cases.emps,
    "panda": cases.panda,
    "lwr4": cases.lwr4,
}
REPEAT = "repeat"


def parse() -> argparse.Namespace:
    """Parse the command line."""
    parser = command_line("real", __doc__)
    names = (*CASES, REPEAT)
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="CASE", help=", ".join(names))
    return parser.parse_args()


def main() -> int:
    """Run every case and print the tables; return 1 when a target is missed."""
    one_thread()
    options, console = parse(), Console(width=200)
    data()
    rows: list[Row] = []
    for name in CASES:
        if name in options.only:
            for row in CASES[name]():
                rows.append(row)
                console.print(f"{row.robot}, {row.concealed}: {'targets met' if row.holds else 'NOT MET'}")
    if rows:
        console.print(show_rows(rows), show_targets(rows), show_left(rows))
    groups = list(repeat.repeats()) if REPEAT in options.only else []
    agreements = [repeat.agree(group) for group in groups]
    if groups:
        console.print(show_repeats(groups, agreements))
    document = {
        "rows": [{**asdict(row), "holds": row.holds} for row in rows],
        "repeats": [asdict(row) for group in groups for row in group],
        "agreements": [{**asdict(one), "holds": one.holds} for one in agreements],
    }
    write_json(options.json, document)
    return 0 if all(row.holds for row in rows) and all(one.holds for one in agreements) else 1


if __name__ == "__main__":
    raise SystemExit(main())
