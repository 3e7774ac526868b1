"""Verdicts in numbers: cells, confusion, reliability, and the targets."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .cases import SUITES
from .judge import Verdict
from .numbers import ROUGH

EDGES = (0.0, 0.5, 0.8, 0.95, 0.99, 1.0)
ENOUGH = 30  # names in a bin that is judged
DOUBT = 2.0  # standard deviations that a bin may be off
LARGE, SMALLEST, PRINTED, SLOWEST = 3, 0.05, 0.05, 7  # joints; sizes; joints of the robots whose time counts
IN_LIBRARY = ("exact", "hard", "none", "pairs")


class Cell(NamedTuple):
    """Sessions of one kind."""

    kind: tuple[str, str]
    outcomes: Counter[str]
    spurious: int
    sure: int

    @property
    def number(self) -> int:
        """Of sessions."""
        return self.outcomes.total()


class Bin(NamedTuple):
    """Causes whose stated probability is within a bin."""

    low: float
    high: float
    names: int
    said: float  # mean
    right: int

    @property
    def holds(self) -> bool | None:
        """Whether as many were right as was said, give or take chance; None where there are too few."""
        if self.names < ENOUGH:
            return None
        return abs(self.right / self.names - self.said) <= DOUBT * math.sqrt(
            max(self.said * (1 - self.said), 0.01) / self.names
        )


@dataclass(frozen=True)
class Target:
    """What is asked for, and what came of it."""

    words: str
    share: float  # or another number; NaN without any session
    bound: float
    of: int
    most: bool = False  # whether the bound must not be passed

    @property
    def met(self) -> bool | None:
        """None where nothing was tried."""
        if not self.of or math.isnan(self.share):
            return None
        return self.share <= self.bound + 1e-12 if self.most else self.share >= self.bound - 1e-12


def cells(verdicts: Iterable[Verdict], by: Callable[[Verdict], str]) -> list[Cell]:
    """By suite, healthy robots that are hard apart, and by something else."""
    groups: dict[tuple[str, str], list[Verdict]] = {}
    for v in verdicts:
        suite = "none, hard" if v.suite == "none" and v.hard else v.suite
        groups.setdefault((suite, by(v)), []).append(v)
    return [
        Cell(key, Counter(v.outcome for v in some), sum(v.spurious for v in some), sum(v.sure for v in some))
        for key, some in sorted(groups.items(), key=lambda x: (_place(x[0][0]), x[1][0].joints > 1, x[1][0].size, x[0]))
    ]


def _place(suite: str) -> tuple[int, str]:
    """Of a suite among the others."""
    return SUITES.index(suite.partition(",")[0]), suite


def by_size(v: Verdict) -> str:
    """Robots of one joint apart."""
    joints = "one joint" if v.joints == 1 else f"{LARGE} joints and more"
    return f"{joints}, {v.size:.0%}" if v.size else joints


def by_robot(v: Verdict) -> str:
    """Its name."""
    return v.robot


def confusion(verdicts: Iterable[Verdict]) -> list[tuple[str, str, str, int]]:
    """Suite, what was concealed, what was named first instead, how often."""
    suites = ("exact", "hard", "foreign", "absent", "removed", "none")
    wrong = [v for v in verdicts if v.suite in suites and v.outcome != "right"]
    counted = Counter((v.suite, v.effect or "nothing", v.first) for v in wrong)
    return [(*key, n) for key, n in sorted(counted.items(), key=lambda x: (suites.index(x[0][0]), -x[1], x[0]))]


def reliability(verdicts: Iterable[Verdict]) -> list[Bin]:
    """Of the causes named where all that is concealed is in the library."""
    names = [name for v in verdicts if v.suite in IN_LIBRARY for name in v.names]
    found = []
    for low, high in zip(EDGES[:-1], EDGES[1:], strict=True):
        some = [(p, ok) for p, ok in names if low <= p < high or high == 1.0 <= p]
        said = float(np.mean([p for p, _ in some])) if some else math.nan
        found.append(Bin(low, high, len(some), said, sum(ok for _, ok in some)))
    return found


def errors(verdicts: Iterable[Verdict], suite: str = "exact", size: float | None = PRINTED) -> dict[str, list[float]]:
    """Relative errors of the numbers of each effect that was named rightly, at a size or any."""
    found: dict[str, list[float]] = {}
    for v in verdicts:
        if v.suite == suite and size in (None, v.size):
            for effect, error in v.errors:
                found.setdefault(effect, []).append(error)
    return found


def targets(verdicts: Sequence[Verdict]) -> Iterator[Target]:
    """Each target with what came of it."""
    large = [v for v in verdicts if v.joints >= LARGE]
    for suite, bounds in (("exact", (0.95, 0.98, 0.98)), ("hard", (0.90, 0.95, 0.95))):
        for size, bound in zip((0.02, 0.05, 0.15), bounds, strict=True):
            some = [v for v in large if v.suite == suite and v.size == size]
            yield _share(f"{suite}, 3 joints and more, {size:.0%}: effect and joint first", some, "right", bound=bound)
    single = [v for v in verdicts if v.suite == "exact" and v.joints == 1]
    yield _share("exact, one joint: truth among what is stated", single, "right", "stated", bound=0.97)
    some = [v for v in large if v.suite == "hard" and v.size >= SMALLEST]
    yield _share("hard, 5 % and more: truth first, or unknown with the right lead", some, "right", "lead", bound=0.97)
    yield _most("false alarms", [v for v in verdicts if v.suite == "none"], lambda v: v.outcome == "alarm", 0.01)
    alone = [v for v in verdicts if v.suite in IN_LIBRARY]
    yield _most("wrong and sure (P > .95)", alone, lambda v: v.sure, 0.01)
    yield _share("pairs: both named", [v for v in verdicts if v.suite == "pairs"], "both", bound=0.93)
    yield _share("foreign: family and joint", [v for v in verdicts if v.suite == "foreign"], "right", bound=0.90)
    yield _share("absent: unknown at the joint", [v for v in verdicts if v.suite == "absent"], "right", bound=0.90)
    yield from _numbers(verdicts)
    for one in reliability(verdicts):
        if one.high == 1.0:
            yield Target("names with P > .99 that are right", one.right / max(one.names, 1), 0.98, one.names)
        elif one.holds is not None:
            words = f"names with P from {one.low:g} to {one.high:g}: as said, give or take chance"
            yield Target(words, float(one.holds), 1.0, one.names)


def _numbers(verdicts: Sequence[Verdict]) -> Iterator[Target]:
    for words, rough, bound in (("plain laws", False, 0.05), ("laws hard to tell", True, 0.15)):
        medians = [(float(np.median(x)), name) for name, x in errors(verdicts).items() if (name in ROUGH) == rough]
        worst, name = max(medians, default=(math.nan, ""))
        yield Target(
            f"exact, median error of numbers at 5 %, {words}: worst is {name}", worst, bound, len(medians), True
        )
    left = [v.after for v in verdicts if v.suite in ("exact", "hard", "pairs") and not math.isnan(v.after)]
    yield Target("residual after, over the noise floor: median", _quantile(left, 0.5), 1.08, len(left), True)
    slow = [v.cpu for v in verdicts if v.joints >= SLOWEST]
    yield Target("CPU of a diagnosis of seven joints, s: 95 % quantile", _quantile(slow, 0.95), 3.0, len(slow), True)


def _share(words: str, some: Sequence[Verdict], *outcomes: str, bound: float) -> Target:
    return Target(words, sum(v.outcome in outcomes for v in some) / max(len(some), 1), bound, len(some))


def _most(words: str, some: Sequence[Verdict], bad: Callable[[Verdict], bool], bound: float) -> Target:
    return Target(words, sum(map(bad, some)) / max(len(some), 1), bound, len(some), True)


def _quantile(x: Sequence[float], q: float) -> float:
    return float(np.quantile(x, q)) if x else math.nan
