"""Factors of one task, added: those of several days, or the parts of one recording."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import reduce as fold
from itertools import chain
from typing import Any

import numpy as np

from ...errors import OptionError, shorten
from ...types import Input
from ..factors import Node, cascade, total
from ..rows import Task
from .reduce import WHOLE, Reduced

SAME = 1e-9  # relative: by which what two machines computed of one task may differ


def add_up(parts: Sequence[Reduced]) -> Reduced:
    """The factors of all recordings as those of one; held-out ones add to held-out ones.

    Factors can be added where their task is the same: robot, held joints, laws, base parameters, band, widths of
    reversals, lags. `reduce(..., like=...)` makes it so. Parts of the same recordings must be complete.

    Args:
        parts: at least one.

    Raises:
        OptionError: they do not belong together, or a part is missing or given twice.
    """
    if not parts:
        raise OptionError("no factors were given; at least one file of them is needed")
    for other in parts[1:]:
        if differs := _difference(parts[0], other):
            raise OptionError(
                f"the factors of {_told(parts[0])} and of {_told(other)} cannot be added: {differs}; "
                f"reduce one of them like the other (--like)"
            )
    whole = fold(_sum, [_joined(found) for found in _sets(parts)])
    learned = dict.fromkeys(file for part in parts for file in part.inputs)
    notes = dict.fromkeys(note for part in parts for note in part.notes)
    return replace(whole, inputs=tuple(learned), notes=tuple(notes))


def _joined(parts: Sequence[Reduced]) -> Reduced:
    """The parts of the same recordings as a whole: to the last bit what one machine makes of them."""
    if len(parts) == 1:
        return parts[0]
    ordered = sorted(parts, key=lambda part: part.share)
    train, held_out = (
        total(cascade(chain.from_iterable(getattr(part, name) for part in ordered))) for name in ("train", "held_out")
    )
    assert train is not None and held_out is not None, "all parts together have windows"
    return replace(ordered[0], train=(Node(0, 0, train),), held_out=(Node(0, 0, held_out),), share=WHOLE)


def _sum(one: Reduced, other: Reduced) -> Reduced:
    train, held_out = (
        getattr(one, name)[0].factors + getattr(other, name)[0].factors for name in ("train", "held_out")
    )
    return replace(one, train=(Node(0, 0, train),), held_out=(Node(0, 0, held_out),))


def _difference(one: Reduced, other: Reduced) -> str:
    """What two tasks differ in, in words; "" where they are the same."""
    for what, of in (("robot or its held joints", _robot), ("laws", _laws), ("base parameters", _base)):
        if not _close(of(one.task), of(other.task)):
            return f"their {what} differ"
    if -1 not in (one.lags, other.lags) and one.lags != other.lags:
        return "one was reduced for white noise"
    if not _close(_filter(one.task), _filter(other.task)):
        bands = " and ".join(f"{each.task.band.cutoff:.3g} Hz" for each in (one, other))
        return f"their filters differ (cut-offs {bands}, and what follows from the noise of each)"
    return ""


def _close(ours: Iterable[Any], theirs: Iterable[Any]) -> bool:
    return all(_alike(a, b) for a, b in zip(ours, theirs, strict=True))


def _alike(a: Any, b: Any) -> bool:
    if not isinstance(a, np.ndarray | float):
        return bool(a == b)
    size = float(np.max(np.abs(a), initial=0.0, where=np.isfinite(a)))
    return np.shape(a) == np.shape(b) and np.allclose(a, b, rtol=SAME, atol=SAME * size)


def _robot(task: Task) -> tuple[Any, ...]:
    robot = task.robot
    return robot.sha256, robot.joints, robot.rest, robot.drive


def _laws(task: Task) -> tuple[Any, ...]:
    return tuple((law.effect.name, law.joints) for law in task.laws), task.recorded_derivatives, task.instruments


def _base(task: Task) -> tuple[Any, ...]:
    return task.base.independent.tolist(), task.base.combination, task.base.sees.tolist()


def _filter(task: Task) -> tuple[Any, ...]:
    band = task.band
    return band.rate, band.factor, band.filtered, band.beyond, band.torque_floor, task.slow, task.reach


def _sets(parts: Sequence[Reduced]) -> list[list[Reduced]]:
    """The parts by the recordings that they are of, each set complete, no recording in two of them."""
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
    of, name, given = parts[0].share[1], _told(parts[0]), sorted(part.share[0] for part in parts)
    if any(part.share[1] != of for part in parts):
        raise OptionError(f"{name} was cut in two ways; give the parts of one")
    if twice := [k for k in given if given.count(k) > 1]:
        what = name if of == 1 else f"part {twice[0]} of {of} of {name}"
        raise OptionError(f"{what} was given twice; give each once")
    if missing := [str(k) for k in range(1, of + 1) if k not in given]:
        raise OptionError(f"of the {of} parts of {name}, {shorten(missing)} is missing; give all of them")


def _told(part: Reduced) -> str:
    return shorten([file.path or "a recording" for file in part.inputs], 2)
