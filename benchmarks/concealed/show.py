"""Verdicts as tables to read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from rich.table import Table

from ..summary import frame
from .judge import Verdict
from .summary import PRINTED, Bin, Cell, Target, by_robot, by_size, cells, confusion, errors, reliability

WORDS = {True: ("met", ""), False: ("NOT MET", "red"), None: ("not tried", "dim")}
OUTCOMES = ("right", "both", "one", "stated", "twin", "lead", "unknown", "missed", "none", "wrong", "alarm")


def tables(verdicts: Sequence[Verdict]) -> Iterator[Table]:
    """All there is to tell but the targets."""
    yield _cells(cells(verdicts, by_size))
    yield _cells(cells(verdicts, by_robot))
    table = frame("what was not right: concealed, and named first", ("suite", "concealed", "named", "times"), left=3)
    for suite, effect, first, n in confusion(verdicts):
        table.add_row(suite, effect, first, str(n))
    yield table
    yield _bins(reliability(verdicts))
    yield _errors(verdicts)
    yield _times(verdicts)


def _cells(found: Sequence[Cell]) -> Table:
    seen = [name for name in OUTCOMES if any(cell.outcomes[name] for cell in found)]
    table = frame("sessions", ("suite", "", "", *seen, "wrong, sure", "spurious"), left=2)
    for cell in found:
        counts = [cell.number, *(cell.outcomes[name] for name in seen), cell.sure, cell.spurious]
        table.add_row(*cell.kind, *(str(n or "") for n in counts))
    return table


def _bins(bins: Sequence[Bin]) -> Table:
    table = frame("stated probability of causes", ("P", "names", "said", "right", ""))
    for one in bins:
        share = [f"{one.said:.3f}", f"{one.right / one.names:.3f}"] if one.names else ["", ""]
        table.add_row(
            f"{one.low:g} to {one.high:g}", str(one.names), *share, "" if one.holds in (True, None) else "off"
        )
    return table


def _errors(verdicts: Sequence[Verdict]) -> Table:
    kinds = [(suite, size) for suite in ("exact", "hard") for size in (PRINTED, None)]
    names = [f"{suite}, {'all sizes' if size is None else f'{size:.0%}'}" for suite, size in kinds]
    table = frame("errors of numbers, median and 90 %", ("effect", *names))
    columns = [errors(verdicts, *kind) for kind in kinds]
    for effect in sorted(set().union(*columns)):
        told = [column.get(effect, []) for column in columns]
        table.add_row(effect, *(f"{np.median(x):.1%} {np.quantile(x, 0.9):.1%} of {len(x)}" if x else "" for x in told))
    return table


def _times(verdicts: Sequence[Verdict]) -> Table:
    names = ("joints", "sessions", "CPU, s: median", "most", "left / floor: median", "90 %")
    table = frame("time, and what is left", names)
    for n in sorted({v.joints for v in verdicts}):
        some = [v for v in verdicts if v.joints == n]
        cpu, left = ([getattr(v, key) for v in some] for key in ("cpu", "after"))
        ratios = [f"{np.nanquantile(left, q):.3f}" if not np.isnan(left).all() else "" for q in (0.5, 0.9)]
        table.add_row(str(n), str(len(some)), f"{np.median(cpu):.2f}", f"{max(cpu):.2f}", *ratios)
    return table


def targets_table(found: Sequence[Target]) -> Table:
    """What was asked for, and what came of it."""
    table = frame("targets", ("", "", "got", "asked", "of"), left=2)
    for target in found:
        word, style = WORDS[target.met]
        small = target.bound <= 1
        got, asked = (f"{x:.1%}" if small else f"{x:.3g}" for x in (target.share, target.bound))
        sign = "at most" if target.most else "at least"
        table.add_row(word, target.words, got if target.of else "", f"{sign} {asked}", str(target.of), style=style)
    return table
