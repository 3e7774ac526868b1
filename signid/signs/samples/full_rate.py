"""Signs of thinned samples -> at the full rate: instants of jumps past zero, and expectations for an unbiased fit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...recording.sampling.grid import Stretch, row_times
from ...regression.rows import Task
from ...regression.session import Part
from ...types import Array, Indices, Mask
from ..observations import motion_windows, predict
from ..result import Trace
from ..segments import place_sign_change
from ..thresholds import JUMP_TORQUE
from .markov_chain import CLEAR_ODDS, coupling, expected_signs

CHUNK = 65_536  # [rows] read at a time; bounds memory
INFLATION = 4.0  # [rows per independent row] kappa of the residual at full rate; heuristic
CONTRADICTS = 0.96  # [1] |expectation| of the opposite sign from which the sign found before stays; heuristic
Weights = NDArray[np.float32]


def place_jumps(task: Task, part: Part, step: int, thinned: Trace, value: Array) -> tuple[Array, Indices, Array]:
    """Add the samples between two thinned ones where torque jumped past zero, with the signs that fit the model best.

    A torque that passes through zero has its smallest absolute value there. A torque that jumps, as at a reversal of
    friction, leaves no such trace, so the jump is placed where the residual of the model with base parameters
    value (b,) [units of base] is smallest. A thinned sample stands for `step` recorded ones. Returns times, beginnings
    of spans and signs as in a `Trace`.
    """
    size = np.nan_to_num(thinned.magnitude)
    large = size > JUMP_TORQUE * np.sqrt(np.mean(size**2, axis=0))
    changing = (thinned.signs[1:] != thinned.signs[:-1]) & large[1:] & large[:-1]
    changing[thinned.first[1:] - 1] = False
    signs, after, t, inner = thinned.signs.copy(), [], [], []
    for at, times, own in _jumps(task, part, step, changing.any(axis=1), thinned.signs, value):
        signs[[at, at + 1]] = own[[0, -1]]
        after += [at] * (len(own) - 2)
        t.append(times[1:-1])
        inner.append(own[1:-1])
    if not after:
        return thinned.t, thinned.first, signs
    place = np.array(after, dtype=np.intp) + 1
    first = thinned.first + np.searchsorted(place, thinned.first, side="right")
    return np.insert(thinned.t, place, np.concatenate(t)), first, np.insert(signs, place, np.concatenate(inner), axis=0)


def _jumps(
    task: Task, part: Part, step: int, changing: Mask, thinned: Array, value: Array
) -> Iterator[tuple[int, Array, Array]]:
    """Thinned samples before a jump; times (K,) and signs (K, n) of all samples from each to the next."""
    passed = 0
    for _, motion, torque, _ in motion_windows(task, part, step):
        count = -(-len(motion) // step)
        for k in np.flatnonzero(changing[passed : passed + count - 1]).tolist():
            here, (before, after) = slice(k * step, (k + 1) * step + 1), thinned[passed + k : passed + k + 2]
            some = replace(motion[here], slow=None)  # friction changes its sign at once
            size, model = np.abs(np.nan_to_num(torque[here])), predict(task, some, value)
            signs = np.repeat(before[None], len(some), axis=0)
            for j in np.flatnonzero(before != after):
                signs[place_sign_change(before[j], after[j], size[:, j], model[:, j]) :, j] = after[j]
            yield passed + k, some.t, signs
        passed += count


def expect_signs(task: Task, part: Part, value: Array, sigma: Array, signs: NDArray[np.int8]) -> Weights:
    """Expectation (rows, n) of the sign of each row, from the torque of a model and the rows around it.

    A torque below its noise that is given the sign of the model is biased towards the model; with the expectation of
    the sign it is not. Near reversals, and where the chain clearly contradicts a sign, the sign stays.

    The model has base parameters value (b,) [units of base], and a residual of standard deviation
    sigma (n,) [N.m or N]. The signs (rows, n) [1] are those found for the rows of the file, 0 where there is none.

    Source: E step of Dempster, Laird, Rubin, J. Royal Statistical Society B 39(1), 1977.
    """
    recording, sampling = part
    grid: list[Weights] = []  # expectations of the samples of the grid, window by window; NaN near reversals
    variance = np.where(sigma > 0, INFLATION * sigma**2, np.inf)
    for _, motion, torque, steady in motion_windows(task, part, 1):
        magnitude = np.abs(np.nan_to_num(torque))
        odds = np.clip(2 * predict(task, motion, value) * magnitude / variance, -CLEAR_ODDS, CLEAR_ODDS)
        expected = expected_signs(odds, coupling(magnitude, np.arange(len(odds)) == 0, 0.0))
        grid.append(np.where(steady, expected, np.nan).astype(np.float32))
    found, ends = signs.astype(np.float32), np.cumsum([stretch.count for stretch in sampling.stretches])
    for stretch, own in zip(sampling.stretches, np.split(np.concatenate(grid), ends[:-1]), strict=True):
        _assign(found, part, stretch, own)
    found[:, recording.signed] = signs[:, recording.signed]
    return found


def _assign(found: Weights, part: Part, stretch: Stretch, expected: Weights) -> None:
    """Assign to each row of a stretch the expectation of the nearest sample of the grid."""
    recording, sampling = part
    for start in range(stretch.start, stretch.stop, CHUNK):
        rows = slice(start, min(start + CHUNK, stretch.stop))
        stamps = row_times(recording, sampling, rows.start, rows.stop)
        place = np.round((stamps - stretch.stamps[0]) / sampling.period).astype(np.intp) - stretch.first
        inside = (place >= 0) & (place < len(expected))
        soft, hard = expected[np.clip(place, 0, len(expected) - 1)], found[rows]
        clash = (np.sign(soft) != hard) & (np.abs(soft) > CONTRADICTS)
        keep = ~inside[:, None] | np.isnan(soft) | (soft == 0) | (hard == 0) | clash
        found[rows] = np.where(keep, hard, soft)
