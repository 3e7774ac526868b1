"""Rows as tables to read."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rich.table import Table

from ..summary import frame
from .coefficients import IDENTIFIABLE, PUBLISHED, QUOTED, Arm, coefficients, entries, identifiable
from .constants import Kind
from .hobby import Report
from .row import Row
from .summary import Bin, Group

Column = tuple[str, Callable[[Row], str]]


def _share(part: float, whole: float = 1.0) -> str:
    return f"{100 * part / whole:.1f} %" if whole else ""


def _number(x: float, form: str = ".3g") -> str:
    return "" if x != x else format(x, form)


COLUMNS: dict[str, Column] = {
    "case": ("case", lambda r: r.case),
    "method": ("method", lambda r: r.method),
    "segments": ("segments", lambda r: f"{r.right}/{r.segments}"),
    "mixed": ("mixed", lambda r: str(r.mixed)),
    "samples": ("samples", lambda r: _share(r.samples)),
    "small": ("small ones", lambda r: "" if r.small != r.small else _share(r.small)),
    "b": ("b", lambda r: str(r.parameters)),
    "error": ("error", lambda r: _number(r.error)),
    "off": ("off signed", lambda r: _number(r.off)),
    "ratio": ("ratio", lambda r: _number(r.ratio)),
    "worse": ("held out", lambda r: _number(r.worse, ".3f")),
    "seconds": ("s", lambda r: f"{r.seconds:.2f}"),
    "proof": ("proof", lambda r: "gap 0" if r.optimal else f"gap {r.gap:.2g}"),
    "nodes": ("nodes", lambda r: str(r.nodes)),
    "flags": ("flags", lambda r: str(len(r.flags) or "")),
}


def show_rows(
    title: str, rows: Sequence[Row], keys: Sequence[str], more: Sequence[tuple[str, Callable[[Row], str]]] = ()
) -> Table:
    """Some columns of some rows; rows that miss their target are red."""
    columns = [*(COLUMNS[key] for key in keys), *more]
    table = frame(title, [name for name, _ in columns])
    for row in rows:
        table.add_row(*(tell(row) for _, tell in columns), style="" if row.holds else "red")
    return table


def show_groups(title: str, groups: Sequence[Group]) -> Table:
    """Runs of one kind in a line each."""
    names = (
        "runs",
        "perfect",
        "proved",
        "segments",
        "mixed",
        "samples",
        "ratio",
        "90 %",
        "s",
        "wrong",
        "told",
        "false",
    )
    table = frame(title, ("", *names))
    for g in groups:
        shares = [_share(g.perfect), _share(g.optimal), f"{_share(g.right)} of {g.segments}", str(g.mixed)]
        rest = [_share(g.samples), f"{g.ratio:.3f}", f"{g.ratio_90:.3g}", f"{g.seconds:.2f}"]
        table.add_row(g.name, str(g.runs), *shares, *rest, str(g.wrong), str(g.alarms), str(g.false_alarms))
    return table


def show_bins(bins: Sequence[Bin]) -> Table:
    """Confidence against what was right."""
    table = frame("confidence of segments, where nothing is flagged", ("given", "segments", "mean given", "right"))
    for one in bins:
        edge = "1" if one.high == 1.0 else f"below {one.high:g}"
        right = f"{one.right} ({_share(one.right, one.segments)})" if one.segments else ""
        table.add_row(f"{one.low:g} to {edge}", str(one.segments), _number(one.said, ".5f"), right)
    return table


def show_entries() -> Table:
    """The printed coefficients of the arm beside the right ones."""
    table = frame("coefficients of the 3R arm, kg.m2 and N.m", ("", "printed", "right", "", "why"))
    for entry in entries():
        told = "wrong" if entry.wrong else ""
        table.add_row(entry.name, f"{entry.published:.{entry.digits}f}", f"{entry.right:.4f}", told, entry.why)
    return table


def show_identifiable() -> Table:
    """The combinations that torque tells."""
    table = frame("the ten combinations that torque tells", ("", "from printed", "right"))
    printed, right = identifiable(PUBLISHED), identifiable(coefficients(Arm()))
    for (name, _), one, other in zip(IDENTIFIABLE, printed, right, strict=True):
        table.add_row(name, f"{one:.4f}", f"{other:.4f}")
    return table


def show_quoted() -> Table:
    """Errors of the paper's four estimates, which are not in the data."""
    table = frame("errors of the paper's four estimates (quoted, not recomputed)", ("against", "1", "2", "3", "4"))
    for name, errors in QUOTED.items():
        table.add_row(name, *(f"{error:g}" for error in errors))
    return table


def show_constants(kinds: Sequence[Kind]) -> Table:
    """Torque constants that were found."""
    names = ("arms", "refused", "constants", "off, median", "largest", "std told", "within 2 std", "segments", "s")
    table = frame("torque constants not known, 2 % noise", ("", *names, "flagged"))
    for kind in kinds:
        shares = [_share(x) for x in (kind.median, kind.largest, kind.said)]
        rest = [f"{kind.inside}/{kind.constants}", f"{kind.right}/{kind.segments}", f"{kind.seconds:.1f}"]
        table.add_row(
            kind.name, str(kind.arms), str(kind.refused), str(kind.constants), *shares, *rest, str(kind.flagged)
        )
    return table


def show_hobby(report: Report) -> Table:
    """What is identified where nobody knows the truth."""
    title = f"SO-101: {report.parameters} base parameters, {len(report.flags)} flags, {report.seconds:.1f} s"
    table = frame(title, ("joint", "segments", "p >= .999", "| |tau| | error", "held out"))
    for told in report.joints:
        table.add_row(told.joint, str(told.segments), str(told.sure), f"{told.train:.2f}", f"{told.held_out:.2f}")
    return table
