"""Run the methods on a set, evaluate them on the rows of C that all of them predict, and show the figures."""

from __future__ import annotations

import traceback
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.table import Table

from signid.errors import SignidError

from ..concealed_real.sets import RealSet
from ..summary import frame
from . import methods
from .task import Answer, Array, Method, Task, build

BASE = "least squares"
Row = dict[str, Any]


@dataclass(frozen=True)
class Score:
    """Figures of a method on a set; empty if it could not run."""

    method: str
    rms: tuple[float, ...] = ()  # [N.m or N] per joint
    r2: tuple[float, ...] = ()
    seconds: float = 0.0  # processor time
    note: str = ""  # the reason if it could not run


@dataclass(frozen=True)
class SetResult:
    """Figures of all methods on one set."""

    name: str
    joints: tuple[str, ...]
    unit: tuple[str, ...]
    rows: tuple[int, ...]  # per joint
    cutoff: float  # [Hz]
    scores: tuple[Score, ...]


def run(one: RealSet, selected: Mapping[str, Method]) -> SetResult:
    """Run all methods on a set; an error of one method becomes its note.

    Raises:
        SignidError: the set cannot be read, or least squares cannot be fitted.
    """
    task = build(one, methods.least_squares)
    found: dict[str, Answer | str] = {name: _answer(method, task) for name, method in selected.items()}
    return evaluate(task, found)


def evaluate(task: Task, found: Mapping[str, Answer | str]) -> SetResult:
    """Compute the figures of each method on the rows that all of them predict."""
    answers = {name: x for name, x in found.items() if isinstance(x, Answer)}
    torque, base = task.held_out.torque, np.isfinite(task.held_out.rest)
    finite = {name: np.isfinite(x.residual) & base for name, x in answers.items() if x.residual.shape == base.shape}
    finite = {name: own for name, own in finite.items() if own.any(axis=0)[base.any(axis=0)].all()}
    counts = np.logical_and.reduce([base, *finite.values()])
    scores = []
    for name, answer in found.items():
        if isinstance(answer, str):
            scores.append(Score(name, note=answer))
        elif name not in finite:
            scores.append(Score(name, seconds=answer.seconds, note="predicts no finite torque on these rows"))
        else:
            scores.append(Score(name, *figures(answer.residual, torque, counts), answer.seconds, answer.note))
    robot = task.least_squares.robot
    unit = tuple("N" if prismatic else "N.m" for prismatic in robot.prismatic)
    return SetResult(task.name, task.joints, unit, tuple(counts.sum(axis=0).tolist()), task.cutoff, tuple(scores))


def figures(residual: Array, torque: Array, counts: np.ndarray) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Rms [N.m or N] and R2 per joint of a residual and a torque (M, n) [N.m or N] over the rows that count (M, n)."""
    rms, r2 = [], []
    for rest, measured, own in zip(residual.T, torque.T, counts.T, strict=True):
        square = float(np.mean(rest[own] ** 2)) if own.any() else np.nan
        power = float(np.var(measured[own])) if own.any() else np.nan
        rms.append(float(np.sqrt(square)))
        r2.append(1 - square / power if power > 0 else np.nan)
    return tuple(rms), tuple(r2)


def _answer(method: Method, task: Task) -> Answer | str:
    try:
        return method(task)
    except SignidError as error:
        return str(error)
    except Exception as error:  # one method must not end the others
        return f"{type(error).__name__}: {error} ({traceback.extract_tb(error.__traceback__)[-1].name})"


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
    """Rms relative to least squares per joint; NaN without figures."""
    base = next((x.rms for x in one.scores if x.method == BASE), ())
    if not base or not score.rms:
        return [np.nan] * len(one.joints)
    return [x / y if y > 0 else np.nan for x, y in zip(score.rms, base, strict=True)]


def geometric(values: Iterable[float]) -> float:
    """Geometric mean of the positive finite values; NaN without any."""
    own = [x for x in values if np.isfinite(x) and x > 0]
    return float(np.exp(np.mean(np.log(own)))) if own else np.nan


def totals(sets: Sequence[SetResult]) -> list[Total]:
    """One total per method, in the order of the first set."""
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
    """Table of rms and R2 per joint for every method on a set."""
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
    """Table with one line per method."""
    names = ("method", "rms over least squares", "joints of all", "better joints", "joints", "sets", "s")
    table = frame("geometric mean over joints", names)
    for one in found:
        means = (f"{x:.3f}" if np.isfinite(x) else "-" for x in (one.ratio, one.shared))
        table.add_row(one.method, *means, str(one.better), str(one.joints), str(one.sets), f"{one.seconds:.1f}")
    return table
