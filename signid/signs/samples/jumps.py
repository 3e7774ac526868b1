"""Signs of thinned samples -> where exactly torque jumped past zero, among the samples that thinning left out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...regression.rows import Task
from ...regression.session import Part
from ...types import Array, Indices, Mask
from ..rows.observations import motion_windows, predict
from ..rows.segments import LARGE, place_sign_change


class Signed(NamedTuple):
    """Samples of one recording and their signs."""

    t: Array  # (M,) [s]
    first: Indices  # (k,) samples at which a span begins
    signs: Array  # (M, n) [1]


class _Jump(NamedTuple):
    """All samples from one of the thinned to the next."""

    after: int  # the thinned sample that they begin with
    t: Array  # (K,) [s]
    size: Array  # (K, n) absolute torque [N.m or N]
    predicted: Array  # (K, n) [N.m or N]


def place_jumps(task: Task, part: Part, step: int, thinned: Signed, magnitude: Array, value: Array) -> Signed:
    """The thinned samples and those between two where torque jumped past zero; there the model tells the place.

    Where torque went through zero it is smallest there. Where it jumped, as it does when friction turns round, absolute
    values do not tell the place.

    Args:
        task: what the samples were made with.
        part: the recording.
        step: samples for one of the thinned.
        thinned: M samples and their signs.
        magnitude: (M, n) their absolute torque [N.m or N]; NaN where none is recorded.
        value: (b,) base parameters [units of base].
    """
    size = np.nan_to_num(magnitude)
    large = size > LARGE * np.sqrt(np.mean(size**2, axis=0))
    turning = (thinned.signs[1:] != thinned.signs[:-1]) & large[1:] & large[:-1]
    turning[thinned.first[1:] - 1] = False
    signs, after, t, inner = thinned.signs.copy(), [], [], []
    for jump in _jumps(task, part, step, turning.any(axis=1), value):
        own = _turned(jump, thinned.signs[jump.after], thinned.signs[jump.after + 1])
        signs[[jump.after, jump.after + 1]] = own[[0, -1]]
        after += [jump.after] * (len(own) - 2)
        t.append(jump.t[1:-1])
        inner.append(own[1:-1])
    if not after:
        return Signed(thinned.t, thinned.first, signs)
    place = np.array(after, dtype=np.intp) + 1
    return Signed(
        np.insert(thinned.t, place, np.concatenate(t)),
        thinned.first + np.searchsorted(place, thinned.first, side="right"),
        np.insert(signs, place, np.concatenate(inner), axis=0),
    )


def _turned(jump: _Jump, before: Array, after: Array) -> Array:
    """(K, n) signs that change once, where what is left of the model is least."""
    signs = np.repeat(before[None], len(jump.t), axis=0)
    for j in np.flatnonzero(before != after):
        size, model = jump.size[:, j], jump.predicted[:, j]
        signs[place_sign_change(before[j], after[j], size, model) :, j] = after[j]
    return signs


def _jumps(task: Task, part: Part, step: int, turning: Mask, value: Array) -> Iterator[_Jump]:
    passed = 0
    for _, motion, _ in motion_windows(task, part, step):
        count = -(-len(motion) // step)
        for k in np.flatnonzero(turning[passed : passed + count - 1]).tolist():
            some = replace(motion[k * step : (k + 1) * step + 1], slow=None)  # friction turns round at once
            assert some.recorded is not None, "windows carry torque"
            yield _Jump(passed + k, some.t, np.abs(np.nan_to_num(some.recorded)), predict(task, some, value))
        passed += count
