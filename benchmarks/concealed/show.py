"""Tables of the evaluations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from rich.table import Table

from ..summary import frame
from .evaluate import Evaluation
from .summary import PRINTED, Bin, Cell, Target, by_robot, by_size, cells, confusion, errors, reliability

WORDS = {True: ("met", ""), False: ("NOT MET", "red"), None: ("not run", "dim")}
OUTCOMES = ("right", "both", "one", "stated", "twin", "lead", "unknown", "missed", "none", "wrong", "alarm")


def tables(evaluations: Sequence[Evaluation]) -> Iterator[Table]:
    """Yield all tables except the targets."""
    yield _cells(cells(evaluations, by_size))
    yield _cells(cells(evaluations, by_robot))
    table = frame(
        "wrong outcomes: concealed effect and first named cause", ("suite", "concealed", "named", "times"), left=3
    )
    for suite, effect, first, n in confusion(evaluations):
        table.add_row(suite, effect, first, str(n))
    yield table
    yield _bins(reliability(evaluations))
    yield _errors(evaluations)
    yield _times(evaluations)


def _cells(found: Sequence[Cell]) -> Table:
    seen = [name for name in OUTCOMES if any(cell.outcomes[name] for cell in found)]
    table = frame("sessions", ("suite", "", "", *seen, "wrong, sure", "spurious"), left=2)
    for cell in found:
        counts = [cell.number, *(cell.outcomes[name] for name in seen), cell.sure, cell.spurious]
        table.add_row(*cell.kind, *(str(n or "") for n in counts))
    return table


def _bins(bins: Sequence[Bin]) -> Table:
    table = frame("stated probability of causes", ("P", "names", "mean P", "right", ""))
    for one in bins:
        share = [f"{one.said:.3f}", f"{one.right / one.names:.3f}"] if one.names else ["", ""]
        table.add_row(
            f"{one.low:g} to {one.high:g}", str(one.names), *share, "" if one.holds in (True, None) else "off"
        )
    return table


def _errors(evaluations: Sequence[Evaluation]) -> Table:
    kinds = [(suite, size) for suite in ("exact", "hard") for size in (PRINTED, None)]
    names = [f"{suite}, {'all sizes' if size is None else f'{size:.0%}'}" for suite, size in kinds]
    table = frame("parameter errors, median and 90 % quantile", ("effect", *names))
    columns = [errors(evaluations, *kind) for kind in kinds]
    for effect in sorted(set().union(*columns)):
        values = [column.get(effect, []) for column in columns]
        table.add_row(
            effect, *(f"{np.median(x):.1%} {np.quantile(x, 0.9):.1%} of {len(x)}" if x else "" for x in values)
        )
    return table


def _times(evaluations: Sequence[Evaluation]) -> Table:
    names = ("joints", "sessions", "CPU, s: median", "most", "residual / floor: median", "90 %")
    table = frame("processor time and residual", names)
    for n in sorted({v.joints for v in evaluations}):
        some = [v for v in evaluations if v.joints == n]
        cpu, residuals = ([getattr(v, key) for v in some] for key in ("cpu", "after"))
        ratios = [f"{np.nanquantile(residuals, q):.3f}" if not np.isnan(residuals).all() else "" for q in (0.5, 0.9)]
        table.add_row(str(n), str(len(some)), f"{np.median(cpu):.2f}", f"{max(cpu):.2f}", *ratios)
    return table


def targets_table(found: Sequence[Target]) -> Table:
    """Table of targets and results."""
    table = frame("targets", ("", "", "result", "target", "of"), left=2)
    for target in found:
        word, style = WORDS[target.met]
        small = target.bound <= 1
        got, asked = (f"{x:.1%}" if small else f"{x:.3g}" for x in (target.share, target.bound))
        sign = "at most" if target.most else "at least"
        table.add_row(word, target.words, got if target.of else "", f"{sign} {asked}", str(target.of), style=style)
    return table
