"""Shares of the rows by kind of change and by set, figures with targets, and tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from rich.table import Table

from ..summary import frame
from .run import CONTROL

Row = dict[str, Any]
EDGES = (0.0, 0.5, 0.9, 0.99, 0.999, 1.0 + 1e-12)  # of the probability bins [1]


@dataclass(frozen=True)
class Share:
    """A count and its total."""

    some: int
    of: int

    def __str__(self) -> str:
        return f"{100 * self.some / self.of:.0f} % ({self.some} of {self.of})" if self.of else "none"


@dataclass(frozen=True)
class Cell:
    """Outcomes of the cases of one kind or one set."""

    name: str
    cases: int
    fair: int
    outcomes: dict[str, int]  # of fair cases
    first_new: int  # fair cases with the truth first among the new causes
    sure: int  # fair cases with a wrong and sure new cause
    within: Share


def changed(rows: Sequence[Row]) -> list[Row]:
    """Select the rows of cases."""
    return [row for row in rows if row["kind"] not in (CONTROL, "set")]


def cell(name: str, rows: Sequence[Row]) -> Cell:
    """Count outcomes over cases."""
    fair = [row for row in rows if row["fair"]]
    outcomes = dict(Counter(row["outcome"] for row in fair))
    numbers = [number for row in fair for number in row["numbers"]]
    within = Share(sum(number["within"] for number in numbers), len(numbers))
    new, sure = (sum(bool(row[key]) for row in fair) for key in ("first_new", "sure"))
    return Cell(name, len(rows), len(fair), outcomes, new, sure, within)


def cells(rows: Sequence[Row], key: Callable[[Row], str]) -> list[Cell]:
    """Count outcomes by a key, in the order of the rows."""
    cases = changed(rows)
    return [cell(name, [r for r in cases if key(r) == name]) for name in dict.fromkeys(map(key, cases))]


def totals(rows: Sequence[Row]) -> dict[str, str]:
    """Figures with targets, as text (names are JSON keys)."""
    cases = changed(rows)
    fair = [row for row in cases if row["fair"]]

    def share(these: Sequence[Row], *outcomes: str) -> str:
        return str(Share(sum(row["outcome"] in outcomes for row in these), len(these)))

    numbers = cell("", cases).within
    held_out = [joint for row in rows for joint in row.get("unseen", [])]
    undone = [joint for row in rows for joint in row.get("undone", [])]
    alone = [joint for row in rows if row["kind"] == CONTROL for joint in row.get("unseen", [])]
    return {
        "named first or flagged (85 %)": share(fair, "first", "flag"),
        "the same, without the causes of the control": str(Share(sum(row["first_new"] for row in fair), len(fair))),
        "in the list (95 %)": share(fair, "first", "flag", "list"),
        "wrong and sure, of all cases (1 %)": str(Share(sum(bool(row["sure"]) for row in cases), len(cases))),
        "numbers within their intervals (90 %)": str(numbers),
        "refused": share(rows, "refused"),
        "crashed": share(rows, "crash"),
        "joints no worse on an unseen recording (98 %)": str(
            Share(sum(not x["worse"] for x in held_out), len(held_out))
        ),
        "the same, of the change itself undone": str(Share(sum(not x["worse"] for x in undone), len(undone))),
        "the same, nothing changed": str(Share(sum(not x["worse"] for x in alone), len(alone))),
        "processor time": f"{sum(row['seconds'] for row in rows):.0f} s",
        "the same, of the slowest": f"{max((row['seconds'] for row in rows), default=0):.1f} s",
    }


def reliability(rows: Sequence[Row]) -> list[tuple[str, int, float, float]]:
    """Bins of the probability of the first new cause: name, number, mean probability, share of right ones."""
    found = []
    for low, high in zip(EDGES, EDGES[1:], strict=False):
        some = [row for row in changed(rows) if row["probability"] and low <= row["probability"] < high]
        if some:
            mean, right = (sum(row[key] for row in some) / len(some) for key in ("probability", "right"))
            found.append((f"{low:g} to {min(high, 1):g}", len(some), mean, right))
    return found


def worse(rows: Sequence[Row]) -> list[tuple[str, str, str, str, float, float]]:
    """Joints that the extended model predicts worse: set, kind, case, joint, rms ratio, error of the square."""
    return [
        (row["set"], row["kind"], row["what"], x["joint"], x["extended"] / x["given"], x["error"])
        for row in rows
        for x in row.get("unseen", [])
        if x["worse"]
    ]


OUTCOMES = ("first", "flag", "list", "missed", "silent", "refused", "crash")


def line(row: Row) -> str:
    """One line of text for a finished case."""
    fair = "" if "fair" not in row else f"bound {row['bound']:.2g} at {row['bound_joint']}"
    if "fair" in row and not row["fair"]:
        fair += ", named by the control" if row["known"] else ", too small"
    text = "; ".join(row.get("causes", [])[:3]) or "; ".join(row["sentences"][:1])
    lost = sum(x["worse"] for x in row.get("unseen", []))
    worse_joints = f", {lost} of {len(row['unseen'])} worse" if row.get("unseen") else ""
    parts = (row["set"], row["kind"], row["what"], row["outcome"], fair, text, f"{row['seconds']:.1f} s{worse_joints}")
    return " | ".join(parts)


def tables(rows: Sequence[Row]) -> Iterator[Table]:
    """Yield tables of cases, counts, reliability and joints that the extended model predicts worse."""
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
