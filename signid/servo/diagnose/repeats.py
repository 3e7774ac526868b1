"""Repeats of one command: how far measured positions differ, which no model of these commands can explain.

Two stretches count as repeats if all commands are equal, row by row. They are compared from the first row at which the
measured positions and speeds of all joints are equal within noise: from there on, every deterministic model of command
and state predicts the same motion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ...servos import ServoGrid
from ...types import Array, Mask
from .result import ServoRepeats

WINDOW = 1.0  # [s] shortest stretch of equal commands
EQUAL = 1e-3  # [1] of the range of a command, up to which two values are equal
MOVING = 0.05  # [1] of its range, by which a command changes within a window
HISTORY = 0.3  # [s] of equal commands before a comparison, unless both recordings begin: longest delay of a drive
BASE = 0.04  # [s] to both sides of a row, over which its speed is measured
LIKE = 4.0  # [1] times noise, within which positions are equal
FADE = 0.1  # [s] in which a difference of speeds fades: as a position, it is within LIKE, too
COMPARED = 0.5  # [s] shortest comparison
MOST = 8  # later repeats of one window that are compared with it


class Pair(NamedTuple):
    """Rows of two stretches whose commands are equal: of grids `a` and `b`, from rows `i` and `j`."""

    a: int
    i: int
    b: int
    j: int
    rows: int


def servo_repeats(
    grids: Sequence[ServoGrid], driven: Sequence[int], noise: Array, error: Callable[[ServoGrid], Array]
) -> ServoRepeats | None:
    """Differences of repeats beside the mismatch of a simulation on the same rows; None without repeats.

    driven: columns of the joints with drives; noise: (n,) [rad or m]; error: simulated minus measured positions (N, n)
    [rad or m] of a grid.
    """
    pairs = [like for pair in repeated(grids, driven) for like in _alike(grids, driven, noise, pair)]
    pairs = [pair for pair in pairs if _counts(grids, driven, pair)]
    if not pairs:
        return None
    errors = {g: error(grids[g]) for g in sorted({g for p in pairs for g in (p.a, p.b)})}
    differences = np.vstack([_rows(grids[p.a].q, p.i, p) - _rows(grids[p.b].q, p.j, p) for p in pairs])[:, driven]
    left = np.vstack([_rows(errors[g], k, p) for p in pairs for g, k in ((p.a, p.i), (p.b, p.j))])[:, driven]
    rms, mismatch = np.sqrt(np.mean(differences**2, axis=0) / 2), np.sqrt(np.mean(left**2, axis=0))
    share = np.minimum((rms / np.maximum(mismatch, 1e-12)) ** 2, 1.0)
    joints = tuple(grids[0].joints[j] for j in driven)
    return ServoRepeats(joints, len(pairs), sum(p.rows for p in pairs) * grids[0].step, rms, mismatch, share)


def repeated(grids: Sequence[ServoGrid], driven: Sequence[int]) -> list[Pair]:
    """Stretches of at least WINDOW whose commands are equal and change, each with its later repeats."""
    inputs = [_inputs(grid, driven) for grid in grids]
    size = np.max([np.max(x, axis=0) for x in inputs], axis=0) - np.min([np.min(x, axis=0) for x in inputs], axis=0)
    tolerance = EQUAL * size + 1e-9
    length = round(WINDOW * grids[0].rate)
    found: list[Pair] = []
    for a, x in enumerate(inputs):
        for i in range(0, len(x) - length + 1, length):
            if not np.any(np.ptp(x[i : i + length, : len(driven)], axis=0) > MOVING * size[: len(driven)] + 1e-9):
                continue
            for k, (b, j) in enumerate(_places(inputs, grids, a, i, length, tolerance)):
                if k >= MOST:
                    break
                if not any(p.a == a and p.b == b and p.j - p.i == j - i and p.i <= i < p.i + p.rows for p in found):
                    found.append(_grown(inputs, Pair(a, i, b, j, length), tolerance))
    return found


def _inputs(grid: ServoGrid, driven: Sequence[int]) -> Array:
    """All that a drive is given, a row each: commands, their speed, feed-forward, torque on or off."""
    given = (grid.command, grid.on, grid.command_speed, grid.feed_forward)
    return np.hstack([x[:, driven] for x in given if x is not None])


def _places(
    inputs: Sequence[Array], grids: Sequence[ServoGrid], a: int, i: int, length: int, tolerance: Array
) -> Iterator[tuple[int, int]]:
    """Later rows (grid, row) at which the window from row i of grid a repeats."""
    window = inputs[a][i : i + length]
    marks = (0, length // 3, 2 * length // 3, length - 1)
    for b in range(a, len(inputs)):
        x, first = inputs[b], i + length if b == a else 0
        count = len(x) - length + 1 - first
        if count <= 0 or x.shape[1] != window.shape[1] or not np.array_equal(grids[a].gain, grids[b].gain):
            continue
        same = np.ones(count, bool)
        for mark in marks:
            rows = np.flatnonzero(same)
            same[rows] = _equal(x[first + rows + mark], window[mark], tolerance)
        for j in (first + np.flatnonzero(same)).tolist():
            if np.all(_equal(x[j : j + length], window, tolerance)):
                yield b, j


def _equal(x: Array, y: Array, tolerance: Array) -> Mask:
    return np.asarray(np.all(np.abs(x - y) <= tolerance, axis=-1))


def _grown(inputs: Sequence[Array], pair: Pair, tolerance: Array) -> Pair:
    """The pair with all rows before and after it that are equal, too."""
    a, i, b, j, rows = pair
    before = min(i, j)
    same = _equal(inputs[a][i - before : i], inputs[b][j - before : j], tolerance)[::-1]
    earlier = before if same.all() else int(np.argmin(same))
    after = min(len(inputs[a]) - i, len(inputs[b]) - j)
    same = _equal(inputs[a][i : i + after], inputs[b][j : j + after], tolerance)
    later = after if same.all() else int(np.argmin(same))
    return Pair(a, i - earlier, b, j - earlier, earlier + later)


def _alike(grids: Sequence[ServoGrid], driven: Sequence[int], noise: Array, pair: Pair) -> Iterator[Pair]:
    """Rows of a pair from the first at which all positions and speeds are equal within noise; none if there is none."""
    one, other = (_rows(grids[g].q, k, pair)[:, driven] for g, k in ((pair.a, pair.i), (pair.b, pair.j)))
    limit, rate = LIKE * np.sqrt(2) * noise[list(driven)], grids[0].rate
    gap = one - other
    if pair.i == 0 and pair.j == 0 and np.all(np.abs(gap[:2]) <= limit):
        start = 0
    else:
        reach = max(round(BASE * rate), 1)
        speed = np.full_like(gap, np.inf)
        speed[reach:-reach] = (gap[2 * reach :] - gap[: -2 * reach]) * rate / (2 * reach)
        like = np.all((np.abs(gap) <= limit) & (np.abs(speed) * FADE <= limit), axis=1)
        like[: round(HISTORY * rate)] = False
        start = int(np.argmax(like)) if like.any() else pair.rows
    if pair.rows - start >= COMPARED * rate:
        yield Pair(pair.a, pair.i + start, pair.b, pair.j + start, pair.rows - start)


def _counts(grids: Sequence[ServoGrid], driven: Sequence[int], pair: Pair) -> bool:
    """Whether a command changes in the rows that are compared, and they are no copies of one recording."""
    if np.array_equal(_rows(grids[pair.a].q, pair.i, pair), _rows(grids[pair.b].q, pair.j, pair)):
        return False
    every = np.vstack([grid.command[:, driven] for grid in grids])
    rows = _rows(grids[pair.a].command, pair.i, pair)[:, driven]
    return bool(np.any(np.ptp(rows, axis=0) > MOVING * np.ptp(every, axis=0) + 1e-9))


def _rows(x: Array, first: int, pair: Pair) -> Array:
    return x[first : first + pair.rows]
