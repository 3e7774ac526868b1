"""Tables of the results."""

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
    """Table of selected columns; rows that miss their target are red."""
    columns = [*(COLUMNS[key] for key in keys), *more]
    table = frame(title, [name for name, _ in columns])
    for row in rows:
        table.add_row(*(text(row) for _, text in columns), style="" if row.holds else "red")
    return table


def show_groups(title: str, groups: Sequence[Group]) -> Table:
    """Table with one line per group of runs."""
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
        "flagged",
        "false flags",
    )
    table = frame(title, ("", *names))
    for g in groups:
        shares = [_share(g.perfect), _share(g.optimal), f"{_share(g.right)} of {g.segments}", str(g.mixed)]
        rest = [_share(g.samples), f"{g.ratio:.3f}", f"{g.ratio_90:.3g}", f"{g.seconds:.2f}"]
        table.add_row(g.name, str(g.runs), *shares, *rest, str(g.wrong), str(g.alarms), str(g.false_alarms))
    return table


def show_bins(bins: Sequence[Bin]) -> Table:
    """Table of confidence and share of right segments."""
    table = frame("confidence of segments in runs without flags", ("confidence", "segments", "mean", "right"))
    for one in bins:
        edge = "1" if one.high == 1.0 else f"below {one.high:g}"
        right = f"{one.right} ({_share(one.right, one.segments)})" if one.segments else ""
        table.add_row(f"{one.low:g} to {edge}", str(one.segments), _number(one.said, ".5f"), right)
    return table


def show_entries() -> Table:
    """Table of printed and correct coefficients of the arm."""
    table = frame("coefficients of the 3R arm, kg.m2 and N.m", ("", "printed", "right", "", "why"))
    for entry in entries():
        mark = "wrong" if entry.wrong else ""
        table.add_row(entry.name, f"{entry.published:.{entry.digits}f}", f"{entry.right:.4f}", mark, entry.why)
    return table


def show_identifiable() -> Table:
    """Table of the identifiable combinations."""
    table = frame("the ten identifiable combinations", ("", "from printed", "right"))
    printed, right = identifiable(PUBLISHED), identifiable(coefficients(Arm()))
    for (name, _), one, other in zip(IDENTIFIABLE, printed, right, strict=True):
        table.add_row(name, f"{one:.4f}", f"{other:.4f}")
    return table


def show_quoted() -> Table:
    """Table of the published errors of the paper's four estimates."""
    table = frame("errors of the paper's four estimates (quoted, not recomputed)", ("against", "1", "2", "3", "4"))
    for name, errors in QUOTED.items():
        table.add_row(name, *(f"{error:g}" for error in errors))
    return table


def show_constants(kinds: Sequence[Kind]) -> Table:
    """Table of identified torque constants."""
    names = ("arms", "refused", "constants", "median error", "largest", "std", "within 2 std", "segments", "s")
    table = frame("unknown torque constants, 2 % noise", ("", *names, "flagged"))
    for kind in kinds:
        shares = [_share(x) for x in (kind.median, kind.largest, kind.said)]
        rest = [f"{kind.inside}/{kind.constants}", f"{kind.right}/{kind.segments}", f"{kind.seconds:.1f}"]
        table.add_row(
            kind.name, str(kind.arms), str(kind.refused), str(kind.constants), *shares, *rest, str(kind.flagged)
        )
    return table


def show_hobby(report: Report) -> Table:
    """Table of results without known truth."""
    title = f"SO-101: {report.parameters} base parameters, {len(report.flags)} flags, {report.seconds:.1f} s"
    table = frame(title, ("joint", "segments", "p >= .999", "| |tau| | error", "held out"))
    for joint in report.joints:
        table.add_row(joint.joint, str(joint.segments), str(joint.sure), f"{joint.train:.2f}", f"{joint.held_out:.2f}")
    return table
