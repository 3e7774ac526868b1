"""Shares of the rows by kind of change and by set, and figures with targets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

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
    """Select the rows of cases.

    Args:
        rows: all rows.
    """
    return [row for row in rows if row["kind"] not in (CONTROL, "set")]


def cell(name: str, rows: Sequence[Row]) -> Cell:
    """Count outcomes over cases.

    Args:
        name: name of the cell.
        rows: cases of the cell.
    """
    fair = [row for row in rows if row["fair"]]
    outcomes = dict(Counter(row["outcome"] for row in fair))
    numbers = [number for row in fair for number in row["numbers"]]
    within = Share(sum(number["within"] for number in numbers), len(numbers))
    new, sure = (sum(bool(row[key]) for row in fair) for key in ("first_new", "sure"))
    return Cell(name, len(rows), len(fair), outcomes, new, sure, within)


def cells(rows: Sequence[Row], key: Callable[[Row], str]) -> list[Cell]:
    """Count outcomes by a key, in the order of the rows.

    Args:
        rows: all rows.
        key: key of a row.
    """
    cases = changed(rows)
    return [cell(name, [r for r in cases if key(r) == name]) for name in dict.fromkeys(map(key, cases))]


def totals(rows: Sequence[Row]) -> dict[str, str]:
    """Figures with targets, as text (names are JSON keys).

    Args:
        rows: all rows.
    """
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
    """Bins of the probability of the first new cause: name, number, mean probability, share of right ones.

    Args:
        rows: all rows.
    """
    found = []
    for low, high in zip(EDGES, EDGES[1:], strict=False):
        some = [row for row in changed(rows) if row["probability"] and low <= row["probability"] < high]
        if some:
            mean, right = (sum(row[key] for row in some) / len(some) for key in ("probability", "right"))
            found.append((f"{low:g} to {min(high, 1):g}", len(some), mean, right))
    return found


def worse(rows: Sequence[Row]) -> list[tuple[str, str, str, str, float, float]]:
    """Joints that the extended model predicts worse: set, kind, case, joint, rms ratio, standard error of the square.

    Args:
        rows: all rows.
    """
    return [
        (row["set"], row["kind"], row["what"], x["joint"], x["extended"] / x["given"], x["error"])
        for row in rows
        for x in row.get("unseen", [])
        if x["worse"]
    ]
