"""Tables of each set, and a summary with one line per method."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from ..summary import frame
from .run import BASE, Score, SetResult


@dataclass(frozen=True)
class Total:
    """Figures of a method over all sets."""

    method: str
    ratio: float  # geometric mean over joints of rms relative to least squares [1]
    shared: float  # the same over the joints that all methods have in common
    better: int  # joints with a smaller rms than least squares
    joints: int
    sets: int
    seconds: float  # processor time


def ratios(one: SetResult, score: Score) -> list[float]:
    """Rms relative to least squares per joint; NaN without figures.

    Args:
        one: results of the set.
        score: figures of the method.
    """
    base = next((x.rms for x in one.scores if x.method == BASE), ())
    if not base or not score.rms:
        return [np.nan] * len(one.joints)
    return [x / y if y > 0 else np.nan for x, y in zip(score.rms, base, strict=True)]


def geometric(values: Iterable[float]) -> float:
    """Geometric mean of the positive finite values; NaN without any.

    Args:
        values: positive ratios.
    """
    own = [x for x in values if np.isfinite(x) and x > 0]
    return float(np.exp(np.mean(np.log(own)))) if own else np.nan


def totals(sets: Sequence[SetResult]) -> list[Total]:
    """One total per method, in the order of the first set.

    Args:
        sets: results of the sets.
    """
    names = list(dict.fromkeys(x.method for one in sets for x in one.scores))
    each = {name: _all(sets, name) for name in names}
    ran = [x for x in each.values() if np.isfinite(x).any()]
    shared = np.isfinite(ran).all(axis=0) if ran else np.zeros(0, bool)
    found = []
    for name, values in each.items():
        own = [x for one in sets for x in one.scores if x.method == name]
        better, count = (int(np.sum(x)) for x in (values < 1, np.isfinite(values)))
        some = sum(bool(x.rms) for x in own)
        seconds = sum(x.seconds for x in own)
        found.append(Total(name, geometric(values), geometric(values[shared]), better, count, some, seconds))
    return found


def set_table(one: SetResult) -> Table:
    """Table of rms and R2 per joint for every method on a set.

    Args:
        one: results of the set.
    """
    names = ("method", *one.joints, "relative", "s", "")
    units = "/".join(dict.fromkeys(one.unit))
    least, most = min(one.rows), max(one.rows)
    rows = f"{most}" if least == most else f"{least} to {most}"
    table = frame(f"{one.name}: held-out rms [{units}] and (R2), {rows} rows per joint, {one.cutoff:.3g} Hz", names)
    table.columns[-1].justify, table.columns[-1].no_wrap = "left", False
    for score in one.scores:
        mean = geometric(ratios(one, score))
        cells = [f"{x:.3g} ({y:.3f})" for x, y in zip(score.rms, score.r2, strict=True)] or ["-"] * len(one.joints)
        relative = f"{mean:.3f}" if np.isfinite(mean) else "-"
        table.add_row(score.method, *cells, relative, f"{score.seconds:.1f}", score.note)
    return table


def _all(sets: Sequence[SetResult], name: str) -> np.ndarray:
    values = list[float]()
    for one in sets:
        score = next((x for x in one.scores if x.method == name), Score(name))
        values += ratios(one, score)
    return np.array(values)


def summary(found: Sequence[Total]) -> Table:
    """Table with one line per method.

    Args:
        found: totals over all sets.
    """
    names = ("method", "rms over least squares", "joints of all", "better joints", "joints", "sets", "s")
    table = frame("geometric mean over joints", names)
    for one in found:
        means = (f"{x:.3f}" if np.isfinite(x) else "-" for x in (one.ratio, one.shared))
        table.add_row(one.method, *means, str(one.better), str(one.joints), str(one.sets), f"{one.seconds:.1f}")
    return table
