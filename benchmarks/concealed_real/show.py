"""Tables of the rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from rich.table import Table

from ..summary import frame
from .summary import Cell, cells, reliability, totals, worse

OUTCOMES = ("first", "flag", "list", "missed", "silent", "refused", "crash")
Row = dict[str, Any]


def line(row: Row) -> str:
    """One line of text for a finished case.

    Args:
        row: row of the case.
    """
    fair = "" if "fair" not in row else f"bound {row['bound']:.2g} at {row['bound_joint']}"
    if "fair" in row and not row["fair"]:
        fair += ", named by the control" if row["known"] else ", too small"
    text = "; ".join(row.get("causes", [])[:3]) or "; ".join(row["sentences"][:1])
    lost = sum(x["worse"] for x in row.get("unseen", []))
    worse_joints = f", {lost} of {len(row['unseen'])} worse" if row.get("unseen") else ""
    parts = (row["set"], row["kind"], row["what"], row["outcome"], fair, text, f"{row['seconds']:.1f} s{worse_joints}")
    return " | ".join(parts)


def tables(rows: Sequence[Row]) -> Iterator[Table]:
    """Yield tables of cases, counts, reliability and joints that the extended model predicts worse.

    Args:
        rows: all rows.
    """
    yield _cases(rows)
    yield _counts("fair cases by kind of change", cells(rows, lambda row: str(row["kind"])))
    yield _counts("fair cases by set", cells(rows, lambda row: str(row["set"])))
    table = frame("probability of the first new cause", ("P", "cases", "mean P", "right"))
    for name, number, mean, right in reliability(rows):
        table.add_row(name, str(number), f"{mean:.3f}", f"{right:.3f}")
    yield table
    table = frame("worse on recording C", ("set", "case", "", "joint", "rms ratio", "std error of the square"), left=4)
    for robot, kind, what, joint, ratio, error in worse(rows):
        table.add_row(robot, kind, what, joint, f"{ratio:.3f}", f"{error:.3f}")
    yield table
    table = frame("summary", ("", ""), left=2)
    for key, value in totals(rows).items():
        table.add_row(key, value)
    yield table


def _cases(rows: Sequence[Row]) -> Table:
    names = ("set", "change", "", "bound", "at", "outcome", "first causes", "P", "numbers", "wrong, sure", "worse", "s")
    table = frame("cases", names, left=3)
    for row in rows:
        fair = row.get("fair", True)
        numbers = [f"{x['key']} {x['value']:.3g} ± {x['std']:.2g} for {x['truth']:.3g}" for x in row.get("numbers", [])]
        lost = sum(x["worse"] for x in row.get("unseen", []))
        table.add_row(
            row["set"],
            row["kind"],
            row["what"],
            f"{row['bound']:.2g}{'' if fair else ' known' if row['known'] else ' small'}" if "bound" in row else "",
            row.get("bound_joint", ""),
            row["outcome"] + (" (twin)" if row.get("relation") == "twin" else ""),
            "\n".join(row.get("causes", [])[:2]) or "\n".join(x[:60] for x in row["sentences"][:1]),
            f"{row['probability']:.3f}" if row.get("probability") else "",
            "\n".join(numbers[:3]),
            str(len(row.get("sure", [])) or ""),
            f"{lost} of {len(row['unseen'])}" if row.get("unseen") else "",
            f"{row['seconds']:.1f}",
            style="" if fair else "dim",
        )
    return table


def _counts(title: str, found: Sequence[Cell]) -> Table:
    names = ("", "cases", "fair", *OUTCOMES, "first new", "wrong, sure", "numbers within")
    table = frame(title, names)
    for one in found:
        counts = [one.cases, one.fair, *(one.outcomes.get(key, 0) for key in OUTCOMES), one.first_new, one.sure]
        table.add_row(one.name, *(str(x or "") for x in counts), str(one.within))
    return table
