"""Run the methods on a set and evaluate them on the rows of C that all of them predict."""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from signid.errors import SignidError

from ..concealed_real.sets import RealSet
from . import methods
from .rows import Array
from .task import Answer, Method, Task, build

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

    Args:
        one: set of recordings.
        selected: methods by name.

    Raises:
        SignidError: the set cannot be read, or least squares cannot be fitted.
    """
    task = build(one, methods.least_squares)
    found: dict[str, Answer | str] = {name: _answer(method, task) for name, method in selected.items()}
    return evaluate(task, found)


def evaluate(task: Task, found: Mapping[str, Answer | str]) -> SetResult:
    """Compute the figures of each method on the rows that all of them predict.

    Args:
        task: data of the set.
        found: answers, or the reasons for missing ones.
    """
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
    """Rms [N.m or N] and R2 per joint over the included rows.

    Args:
        residual: residual (M, n) [N.m or N].
        torque: measured torque (M, n) [N.m or N].
        counts: mask of included rows (M, n).
    """
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
