"""Sum of the factors of one task: of several recordings, or of the parts of one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce as fold
from itertools import chain
from operator import add
from typing import Any

import numpy as np

from ...errors import OptionError, shorten
from ...types import Input
from ..factors import Factors, Node, cascade, total
from ..rows import Task
from .reduce import WHOLE, Reduced

SAME = 1e-9  # [1] relative tolerance between tasks that two machines computed
FILTERS = "filters"
SUMS = ("train", "held_out")


def add_up(parts: Sequence[Reduced]) -> Reduced:
    """Sum of factors: as if all recordings were reduced together; held-out factors add to held-out factors.

    The factors, at least one, must have the same task: robot, held joints, laws, base parameters, band, widths of
    reversals, lags. `reduce(..., like=...)` ensures this. Parts of the same recordings must be complete.

    Raises:
        OptionError: the tasks differ, or a part is missing or given twice.
    """
    if not parts:
        raise OptionError("no factors were given; give at least one file of factors")
    for other in parts[1:]:
        if differs := _difference(parts[0], other):
            raise OptionError(
                f"the factors of {_names(parts[0])} and of {_names(other)} cannot be added: {differs}; "
                f"reduce one of them like the other (--like)"
            )
    joined = [_joined(found) for found in _sets(parts)]
    train, held_out = (fold(add, [getattr(part, name)[0].factors for part in joined]) for name in SUMS)
    files = tuple(dict.fromkeys(file for part in parts for file in part.inputs))
    notes = tuple(dict.fromkeys(note for part in parts for note in part.notes))
    return replace(joined[0], train=_whole(train), held_out=_whole(held_out), inputs=files, notes=notes)


def _joined(parts: Sequence[Reduced]) -> Reduced:
    """Sum of the parts of the same recordings, equal to the last bit to the factors of the whole."""
    if len(parts) == 1:
        return parts[0]
    ordered = sorted(parts, key=lambda part: part.share)
    train, held_out = (total(cascade(chain(*(getattr(part, name) for part in ordered)))) for name in SUMS)
    assert train is not None and held_out is not None, "all parts together have windows"
    return replace(ordered[0], train=_whole(train), held_out=_whole(held_out), share=WHOLE)


def _whole(factors: Factors) -> tuple[Node]:
    return (Node(0, 0, factors),)


def _difference(one: Reduced, other: Reduced) -> str:
    """Sentence on the first difference of two tasks; "" if they are the same."""
    pairs = zip(_definition(one.task).items(), _definition(other.task).values(), strict=True)
    differs = next((name for (name, ours), theirs in pairs if not all(map(_alike, ours, theirs))), "")
    if differs and differs != FILTERS:
        return f"their {differs} differ"
    if -1 not in (one.lags, other.lags) and one.lags != other.lags:
        return "one was reduced for white noise"
    if differs:
        bands = " and ".join(f"{each.task.band.cutoff:.3g} Hz" for each in (one, other))
        return f"their filters differ (cut-offs {bands}, or the noise levels that set them)"
    return ""


def _definition(task: Task) -> dict[str, tuple[Any, ...]]:
    """Everything that the rows of a task depend on, under the names in messages."""
    robot, base, band = task.robot, task.base, task.band
    laws = tuple((law.effect.name, law.joints) for law in task.laws)
    return {
        "robot or its held joints": (robot.sha256, robot.joints, robot.rest, robot.drive),
        "gravity": (np.array(robot.model.gravity.linear),),
        "laws": (laws, task.recorded_derivatives, task.instruments),
        "base parameters": (base.independent.tolist(), base.combination, base.sees.tolist()),
        FILTERS: (band.rate, band.factor, band.filtered, band.beyond, band.torque_floor, task.slow, task.reach),
    }


def _alike(a: Any, b: Any) -> bool:
    if not isinstance(a, np.ndarray | float):
        return bool(a == b)
    size = float(np.max(np.abs(a), initial=0.0, where=np.isfinite(a)))
    return np.shape(a) == np.shape(b) and np.allclose(a, b, rtol=SAME, atol=SAME * size)


def _sets(parts: Sequence[Reduced]) -> list[list[Reduced]]:
    """Parts grouped by their recordings, after a check that each group is complete and no recording is in two."""
    sets: dict[tuple[Input, ...], list[Reduced]] = {}
    for part in parts:
        sets.setdefault(part.inputs, []).append(part)
    for found in sets.values():
        _check_complete(found)
    seen: dict[str, str] = {}
    for inputs in sets:
        for file in inputs:
            if file.sha256 in seen:
                again = f"{file.path or 'one recording'} holds the same samples as {seen[file.sha256] or 'another'}"
                raise OptionError(f"{again}; give each recording once")
        seen |= {file.sha256: file.path for file in inputs}
    return list(sets.values())


def _check_complete(parts: Sequence[Reduced]) -> None:
    of, name, given = parts[0].share[1], _names(parts[0]), sorted(part.share[0] for part in parts)
    if any(part.share[1] != of for part in parts):
        raise OptionError(f"{name} was cut in two different ways; give the parts of one of them")
    if twice := [k for k in given if given.count(k) > 1]:
        repeated = name if of == 1 else f"part {twice[0]} of {of} of {name}"
        raise OptionError(f"{repeated} was given twice; give each once")
    if missing := [str(k) for k in range(1, of + 1) if k not in given]:
        raise OptionError(f"part {shorten(missing)} of the {of} parts of {name} is missing; give all of them")


def _names(part: Reduced) -> str:
    return shorten([file.path or "a recording" for file in part.inputs], 2)
