"""Signs of thinned samples -> exact instants of jumps past zero, among the samples that thinning left out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...regression.rows import Task
from ...regression.session import Part
from ...types import Array, Indices, Mask
from ..rows.observations import motion_windows, predict
from ..rows.segments import place_sign_change
from ..thresholds import JUMP_TORQUE


class Signed(NamedTuple):
    """M samples of one recording and their signs."""

    t: Array  # (M,) [s]
    first: Indices  # (k,) samples at which a span begins
    signs: Array  # (M, n) [1]


class _Jump(NamedTuple):
    """All K samples from one thinned sample to the next, both included."""

    after: int  # index of the thinned sample at which they begin
    t: Array  # (K,) [s]
    size: Array  # (K, n) absolute torque [N.m or N]
    predicted: Array  # (K, n) [N.m or N]


def place_jumps(task: Task, part: Part, step: int, thinned: Signed, magnitude: Array, value: Array) -> Signed:
    """Add the samples between two thinned ones where torque jumped past zero, with the signs that fit the model best.

    A torque that passes through zero has its smallest absolute value there. A torque that jumps, as at a reversal of
    friction, leaves no such trace, so the jump is placed where the residual of the model is smallest.

    Args:
        task: robot, laws, base map and band of the samples.
        part: recording and its sampling.
        step: number of recorded samples per thinned sample.
        thinned: M thinned samples and their signs.
        magnitude: (M, n) absolute torque of the thinned samples [N.m or N]; NaN where none is recorded.
        value: (b,) base parameters [units of base].
    """
    size = np.nan_to_num(magnitude)
    large = size > JUMP_TORQUE * np.sqrt(np.mean(size**2, axis=0))
    changing = (thinned.signs[1:] != thinned.signs[:-1]) & large[1:] & large[:-1]
    changing[thinned.first[1:] - 1] = False
    signs, after, t, inner = thinned.signs.copy(), [], [], []
    for jump in _jumps(task, part, step, changing.any(axis=1), value):
        own = _placed(jump, thinned.signs[jump.after], thinned.signs[jump.after + 1])
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


def _placed(jump: _Jump, before: Array, after: Array) -> Array:
    """Signs (K, n) that change once per joint, where the squared residual of the model is smallest."""
    signs = np.repeat(before[None], len(jump.t), axis=0)
    for j in np.flatnonzero(before != after):
        size, model = jump.size[:, j], jump.predicted[:, j]
        signs[place_sign_change(before[j], after[j], size, model) :, j] = after[j]
    return signs


def _jumps(task: Task, part: Part, step: int, changing: Mask, value: Array) -> Iterator[_Jump]:
    passed = 0
    for _, motion, _ in motion_windows(task, part, step):
        count = -(-len(motion) // step)
        for k in np.flatnonzero(changing[passed : passed + count - 1]).tolist():
            some = replace(motion[k * step : (k + 1) * step + 1], slow=None)  # friction changes its sign at once
            assert some.recorded is not None, "windows carry torque"
            yield _Jump(passed + k, some.t, np.abs(np.nan_to_num(some.recorded)), predict(task, some, value))
        passed += count
