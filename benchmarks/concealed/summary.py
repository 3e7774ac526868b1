"""Statistics of the evaluations: cells, confusion, reliability and targets, and their tables."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from rich.table import Table

from ..summary import frame
from .cases import SUITES
from .evaluate import ROUGH, Evaluation

EDGES = (0.0, 0.5, 0.8, 0.95, 0.99, 1.0)  # of the probability bins [1]
ENOUGH = 30  # fewest names for the test of a bin
TOLERANCE = 2.0  # tolerated deviation of a bin [standard deviations]
LARGE, SMALLEST, PRINTED, SLOWEST = 3, 0.05, 0.05, 7  # fewest joints; sizes [1]; fewest joints for the time target
IN_LIBRARY = ("exact", "hard", "none", "pairs")


class Cell(NamedTuple):
    """Sessions of one kind."""

    kind: tuple[str, str]
    outcomes: Counter[str]
    spurious: int
    sure: int

    @property
    def number(self) -> int:
        """Number of sessions."""
        return self.outcomes.total()


class Bin(NamedTuple):
    """Causes with a probability within a bin."""

    low: float
    high: float
    names: int
    said: float  # mean probability
    right: int

    @property
    def holds(self) -> bool | None:
        """Whether the share of right causes agrees with the probability within chance; None with too few causes."""
        if self.names < ENOUGH:
            return None
        return abs(self.right / self.names - self.said) <= TOLERANCE * math.sqrt(
            max(self.said * (1 - self.said), 0.01) / self.names
        )


@dataclass(frozen=True)
class Target:
    """A target and its result."""

    words: str
    share: float  # share or another number; NaN without sessions
    bound: float
    of: int
    most: bool = False  # the bound is an upper one

    @property
    def met(self) -> bool | None:
        """Whether the target is met; None without sessions."""
        if not self.of or math.isnan(self.share):
            return None
        return self.share <= self.bound + 1e-12 if self.most else self.share >= self.bound - 1e-12


def cells(evaluations: Iterable[Evaluation], by: Callable[[Evaluation], str]) -> list[Cell]:
    """Group by suite (hard healthy robots separately) and by a key."""
    groups: dict[tuple[str, str], list[Evaluation]] = {}
    for v in evaluations:
        suite = "none, hard" if v.suite == "none" and v.hard else v.suite
        groups.setdefault((suite, by(v)), []).append(v)
    return [
        Cell(key, Counter(v.outcome for v in some), sum(v.spurious for v in some), sum(v.sure for v in some))
        for key, some in sorted(groups.items(), key=lambda x: (_place(x[0][0]), x[1][0].joints > 1, x[1][0].size, x[0]))
    ]


def _place(suite: str) -> tuple[int, str]:
    """Sort key of a suite."""
    return SUITES.index(suite.partition(",")[0]), suite


def by_size(v: Evaluation) -> str:
    """Key: number of joints and size."""
    joints = "one joint" if v.joints == 1 else f"{LARGE} joints and more"
    return f"{joints}, {v.size:.0%}" if v.size else joints


def by_robot(v: Evaluation) -> str:
    """Key: name of the robot."""
    return v.robot


def confusion(evaluations: Iterable[Evaluation]) -> list[tuple[str, str, str, int]]:
    """Counts of wrong outcomes: suite, concealed effect, first named cause, number."""
    suites = ("exact", "hard", "foreign", "absent", "removed", "none")
    wrong = [v for v in evaluations if v.suite in suites and v.outcome != "right"]
    counted = Counter((v.suite, v.effect or "nothing", v.first) for v in wrong)
    return [(*key, n) for key, n in sorted(counted.items(), key=lambda x: (suites.index(x[0][0]), -x[1], x[0]))]


def reliability(evaluations: Iterable[Evaluation]) -> list[Bin]:
    """Bins of the causes in suites whose effects are all in the library."""
    names = [name for v in evaluations if v.suite in IN_LIBRARY for name in v.names]
    found = []
    for low, high in zip(EDGES[:-1], EDGES[1:], strict=True):
        some = [(p, ok) for p, ok in names if low <= p < high or high == 1.0 <= p]
        said = float(np.mean([p for p, _ in some])) if some else math.nan
        found.append(Bin(low, high, len(some), said, sum(ok for _, ok in some)))
    return found


def errors(
    evaluations: Iterable[Evaluation], suite: str = "exact", size: float | None = PRINTED
) -> dict[str, list[float]]:
    """Relative parameter errors of each correctly named effect, at one size or any."""
    found: dict[str, list[float]] = {}
    for v in evaluations:
        if v.suite == suite and size in (None, v.size):
            for effect, error in v.errors:
                found.setdefault(effect, []).append(error)
    return found


def targets(evaluations: Sequence[Evaluation]) -> Iterator[Target]:
    """Yield each target with its result."""
    large = [v for v in evaluations if v.joints >= LARGE]
    for suite, bounds in (("exact", (0.95, 0.98, 0.98)), ("hard", (0.90, 0.95, 0.95))):
        for size, bound in zip((0.02, 0.05, 0.15), bounds, strict=True):
            some = [v for v in large if v.suite == suite and v.size == size]
            yield _share(f"{suite}, 3 joints and more, {size:.0%}: effect and joint first", some, "right", bound=bound)
    single = [v for v in evaluations if v.suite == "exact" and v.joints == 1]
    yield _share("exact, one joint: truth among findings and alternatives", single, "right", "stated", bound=0.97)
    some = [v for v in large if v.suite == "hard" and v.size >= SMALLEST]
    yield _share("hard, 5 % and more: truth first, or unknown with the right lead", some, "right", "lead", bound=0.97)
    yield _most("false alarms", [v for v in evaluations if v.suite == "none"], lambda v: v.outcome == "alarm", 0.01)
    alone = [v for v in evaluations if v.suite in IN_LIBRARY]
    yield _most("wrong and sure (P > .95)", alone, lambda v: v.sure, 0.01)
    yield _share("pairs: both named", [v for v in evaluations if v.suite == "pairs"], "both", bound=0.93)
    yield _share("foreign: family and joint", [v for v in evaluations if v.suite == "foreign"], "right", bound=0.90)
    yield _share("absent: unknown at the joint", [v for v in evaluations if v.suite == "absent"], "right", bound=0.90)
    yield from _numbers(evaluations)
    for one in reliability(evaluations):
        if one.high == 1.0:
            yield Target("names with P > .99 that are right", one.right / max(one.names, 1), 0.98, one.names)
        elif one.holds is not None:
            words = f"names with P from {one.low:g} to {one.high:g}: share of right ones agrees within chance"
            yield Target(words, float(one.holds), 1.0, one.names)


def _numbers(evaluations: Sequence[Evaluation]) -> Iterator[Target]:
    for words, rough, bound in (("plain laws", False, 0.05), ("less accurate laws", True, 0.15)):
        medians = [(float(np.median(x)), name) for name, x in errors(evaluations).items() if (name in ROUGH) == rough]
        worst, name = max(medians, default=(math.nan, ""))
        said = f"exact, median parameter error at 5 %, {words}: worst is {name}"
        yield Target(said, worst, bound, len(medians), most=True)
    residuals = [v.after for v in evaluations if v.suite in ("exact", "hard", "pairs") and not math.isnan(v.after)]
    said = "residual of the extended model over the noise floor: median"
    yield Target(said, _quantile(residuals, 0.5), 1.08, len(residuals), most=True)
    slow = [v.cpu for v in evaluations if v.joints >= SLOWEST]
    yield Target("CPU of a diagnosis of seven joints, s: 95 % quantile", _quantile(slow, 0.95), 3.0, len(slow), True)


def _share(words: str, some: Sequence[Evaluation], *outcomes: str, bound: float) -> Target:
    return Target(words, sum(v.outcome in outcomes for v in some) / max(len(some), 1), bound, len(some))


def _most(words: str, some: Sequence[Evaluation], bad: Callable[[Evaluation], bool], bound: float) -> Target:
    return Target(words, sum(map(bad, some)) / max(len(some), 1), bound, len(some), True)


def _quantile(x: Sequence[float], q: float) -> float:
    return float(np.quantile(x, q)) if x else math.nan


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
