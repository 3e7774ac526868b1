"""What the three say, as tables to read."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from ..summary import frame
from .row import Heard, Row
from .said import Said

ABSENT = "not installed"


def tables(rows: Sequence[Row], versions: tuple[str, str]) -> tuple[Table, Table, Table]:
    """One of each, signid first."""
    return show_signid(rows), show_figaroh(rows, versions[0]), show_mujoco(rows, versions[1])


def show_signid(rows: Sequence[Row]) -> Table:
    """Verdict, first finding, held-out error."""
    names = ("what is wrong", "signid", "first finding", "P", "number (truth)", "joints", "held out / floor", "CPU s")
    table = frame("signid", names, left=3)
    for row in rows:
        x = row.signid
        ratio = f"{x.before:.2f} -> {x.after:.2f}"
        cells = (row.case.name, x.outcome, *_first(x), _places(row), ratio, f"{x.seconds:.1f}")
        table.add_row(*cells, style="" if x.right else "red")
    return table


def show_figaroh(rows: Sequence[Row], version: str) -> Table:
    """Errors and lines of the report."""
    names = ("what is wrong", "new lines of its report", "names it", "fit, N.m", "held out", "joints beyond", "CPU s")
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
    """Cost, errors, coverage, insights."""
    names = ("what is wrong", "insights", "names it", "cost", "x clean", "armature off", "covered", "CPU s")
    table = frame(f"mujoco.sysid {version or ABSENT}", names, left=3)
    for row in rows:
        x, answer = row.mujoco, row.mujoco.answer
        if answer is None or "failed" in answer:
            table.add_row(row.case.name, _silent(row, answer, version))
            continue
        told = "all within their bounds" if "within their bounds" in answer["insights"][0] else _bounds(answer)
        numbers = (f"{answer['cost']:.4f}", f"{x.ratio:.2f}", f"{100 * answer['errors']['armature']:.1f} %")
        table.add_row(
            row.case.name, told, _names(row, x), *numbers, f"{answer['coverage']:.2f}", f"{answer['seconds']:.1f}"
        )
    return table


def _first(x: Said) -> tuple[str, str, str]:
    if not x.findings:
        return x.verdict.replace("_", " "), "", ""
    one = x.findings[0]
    told = f"{one.key} {one.value:.4g}" + ("" if one.std is None else f" ± {one.std:.2g}")
    truth = "" if one.truth is None else f" ({one.truth:.4g})"
    return f"{one.effect}, {one.joint or 'robot'}", f"{one.probability:.3f}", told + truth


def _places(row: Row) -> str:
    """Of the joints with the fault, how many are named."""
    return f"{row.signid.joints}/{len(row.case.faults)}" if row.case.faults else ""


def _silent(row: Row, answer: dict[str, object] | None, version: str) -> str:
    if answer is not None:
        return f"failed: {answer['failed']}"
    return "cannot be told" if row.case.told and version else ABSENT


def _lines(x: Heard) -> str:
    return "none" if not x.new else f"{len(x.new)}: {x.new[0][:60]}"


def _bounds(answer: dict[str, list[str]]) -> str:
    return f"at a bound: {len(answer['insights'])}"


def _names(row: Row, x: Heard) -> str:
    return "" if not row.case.effect else "yes" if x.named else "no"
