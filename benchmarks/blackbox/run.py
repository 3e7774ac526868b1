"""Run the methods on a set, and judge all on the rows of C that all of them predict."""

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
    """A method on a set; no figures where it could not be run."""

    method: str
    rms: tuple[float, ...] = ()  # [N.m or N] per joint
    r2: tuple[float, ...] = ()
    seconds: float = 0.0  # processor time
    note: str = ""  # the reason where it could not be run


@dataclass(frozen=True)
class Judged:
    """All methods on the rows of one set."""

    name: str
    joints: tuple[str, ...]
    unit: tuple[str, ...]
    rows: tuple[int, ...]  # per joint
    cutoff: float  # [Hz]
    scores: tuple[Score, ...]


def run(one: RealSet, asked: Mapping[str, Method]) -> Judged:
    """All methods on a set; a refusal or a crash of one is a dash with the reason.

    Args:
        one: the set.
        asked: methods by their names.

    Raises:
        SignidError: the set cannot be read, or least squares cannot be fitted.
    """
    task = build(one, methods.least_squares)
    found: dict[str, Answer | str] = {name: _answer(method, task) for name, method in asked.items()}
    return judge(task, found)


def judge(task: Task, found: Mapping[str, Answer | str]) -> Judged:
    """Figures of each method on the rows that all of them predict.

    Args:
        task: the data.
        found: answers, or the reason why there is none.
    """
    answers = {name: x for name, x in found.items() if isinstance(x, Answer)}
    torque, base = task.judged.torque, np.isfinite(task.judged.rest)
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
    return Judged(task.name, task.joints, unit, tuple(counts.sum(axis=0).tolist()), task.cutoff, tuple(scores))


def figures(residual: Array, torque: Array, counts: np.ndarray) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Rms [N.m or N] and R2 per joint over the rows that count.

    Args:
        residual: (M, n) [N.m or N].
        torque: (M, n) [N.m or N] measured.
        counts: (M, n) whether a row counts.
    """
    rms, r2 = [], []
    for rest, measured, own in zip(residual.T, torque.T, counts.T, strict=True):
        left = float(np.mean(rest[own] ** 2)) if own.any() else np.nan
        power = float(np.var(measured[own])) if own.any() else np.nan
        rms.append(float(np.sqrt(left)))
        r2.append(1 - left / power if power > 0 else np.nan)
    return tuple(rms), tuple(r2)


def _answer(method: Method, task: Task) -> Answer | str:
    try:
        return method(task)
    except SignidError as error:
        return str(error)
    except Exception as error:  # one method must not end the others
        return f"{type(error).__name__}: {error} ({traceback.extract_tb(error.__traceback__)[-1].name})"
