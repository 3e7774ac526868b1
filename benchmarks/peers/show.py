"""Tables of the results of the three tools."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from ..summary import frame
from .findings import Result
from .row import PeerResult, Row

ABSENT = "not installed"


def tables(rows: Sequence[Row], versions: tuple[str, str]) -> tuple[Table, Table, Table]:
    """One table per tool, signid first."""
    return show_signid(rows), show_figaroh(rows, versions[0]), show_mujoco(rows, versions[1])


def show_signid(rows: Sequence[Row]) -> Table:
    """Table of outcome, first finding and held-out error."""
    names = ("fault", "signid", "first finding", "P", "number (truth)", "joints", "held out / floor", "CPU s")
    table = frame("signid", names, left=3)
    for row in rows:
        x = row.signid
        ratio = f"{x.before:.2f} -> {x.after:.2f}"
        cells = (row.case.name, x.outcome, *_first(x), _places(row), ratio, f"{x.seconds:.1f}")
        table.add_row(*cells, style="" if x.right else "red")
    return table


def show_figaroh(rows: Sequence[Row], version: str) -> Table:
    """Table of errors and report lines."""
    names = ("fault", "new report lines", "names it", "fit, N.m", "held out", "joints beyond", "CPU s")
    table = frame(f"figaroh {version or ABSENT}", names, left=3)
    for row in rows:
        x, answer = row.figaroh, row.figaroh.answer
        if answer is None or "failed" in answer:
            table.add_row(row.case.name, _silent(row, answer, version))
            continue
        errors = (f"{answer['rmse']:.3f}", f"{answer['held_out']:.3f}", f"{len(x.beyond)}")
        table.add_row(row.case.name, _lines(x), _names(row, x), *errors, f"{answer['seconds']:.1f}")
    return table


def show_mujoco(rows: Sequence[Row], version: str) -> Table:
    """Table of cost, errors, coverage and insights."""
    names = ("fault", "insights", "names it", "cost", "x clean", "armature off", "covered", "CPU s")
    table = frame(f"mujoco.sysid {version or ABSENT}", names, left=3)
    for row in rows:
        x, answer = row.mujoco, row.mujoco.answer
        if answer is None or "failed" in answer:
            table.add_row(row.case.name, _silent(row, answer, version))
            continue
        insights = "all within their bounds" if "within their bounds" in answer["insights"][0] else _bounds(answer)
        numbers = (f"{answer['cost']:.4f}", f"{x.ratio:.2f}", f"{100 * answer['errors']['armature']:.1f} %")
        table.add_row(
            row.case.name, insights, _names(row, x), *numbers, f"{answer['coverage']:.2f}", f"{answer['seconds']:.1f}"
        )
    return table


def _first(x: Result) -> tuple[str, str, str]:
    if not x.findings:
        return x.verdict.replace("_", " "), "", ""
    one = x.findings[0]
    value = f"{one.key} {one.value:.4g}" + ("" if one.std is None else f" ± {one.std:.2g}")
    truth = "" if one.truth is None else f" ({one.truth:.4g})"
    return f"{one.effect}, {one.joint or 'robot'}", f"{one.probability:.3f}", value + truth


def _places(row: Row) -> str:
    """Number of named joints among those with the fault."""
    return f"{row.signid.joints}/{len(row.case.faults)}" if row.case.faults else ""


def _silent(row: Row, answer: dict[str, object] | None, version: str) -> str:
    if answer is not None:
        return f"failed: {answer['failed']}"
    return "not supported" if row.case.declared and version else ABSENT


def _lines(x: PeerResult) -> str:
    return "none" if not x.new else f"{len(x.new)}: {x.new[0][:60]}"


def _bounds(answer: dict[str, list[str]]) -> str:
    return f"at a bound: {len(answer['insights'])}"


def _names(row: Row, x: PeerResult) -> str:
    return "" if not row.case.effect else "yes" if x.named else "no"
