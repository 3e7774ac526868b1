"""Signs and zeros of recorded positions against the description, checked by what gravity does to the loop's error."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ...model import Model
from ...parameters import Array
from ...robot import configuration
from ...servos import ServoGrid
from ...types import Mask, Robot
from ..plant.course import bodies_of, motion_of
from ..search.data import ServoData

ROWS = 400  # of all recordings
STEPS = 24  # zeros that are tried in a turn
SWEEPS = 2
EDGE = 0.3  # [s] left out at the ends
MOST_JOINTS = 7  # beyond them the search over zeros is too long
SAVED = 0.3  # sum over joints of the log rms error on rows that took no part that another zero or sign must save


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of all recordings: error, position and columns of each joint; `half` marks the rows that are fitted."""

    q: Array  # (N, n) [rad or m]
    error: Array  # (N, n)
    v: Array  # (N, n)
    a: Array  # (N, n)
    half: Mask  # (N,)


def zero_flags(model: Model, data: ServoData) -> Iterator[str]:
    """A sentence on each joint whose sign or zero seems to differ from the description; nothing is changed."""
    robot = bodies_of(model, data.joints)
    turning = [j for j, joint in enumerate(data.joints) if joint in data.driven and not robot.prismatic[j]]
    if len(turning) > MOST_JOINTS:
        return
    rows = _rows(data)
    signs, zeros = np.ones(len(data.joints)), np.zeros(len(data.joints))
    score = first = _score(robot, rows, signs, zeros)
    for _ in range(SWEEPS):
        for j in turning:
            for sign in (1.0, -1.0):
                for zero in np.arange(STEPS) * 2 * np.pi / STEPS:
                    trial = signs.copy(), zeros.copy()
                    trial[0][j], trial[1][j] = sign, zero
                    new = _score(robot, rows, *trial)
                    if new < score - SAVED:
                        score, (signs, zeros) = new, trial
    if score > first - SAVED:
        return
    for j in turning:
        turn = (zeros[j] + np.pi) % (2 * np.pi) - np.pi
        if signs[j] < 0 or turn:
            what = " and the opposite sign" if signs[j] < 0 else ""
            yield (
                f"{data.joints[j]}: gravity fits the recording better with a zero that is about {turn:.2g} rad "
                f"off{what}; compare zero and sign of the recorded positions with the description, since nothing was "
                f"changed and the scale rests on its gravity"
            )


def _rows(data: ServoData) -> _Rows:
    step = max(sum(map(len, data.train)) // ROWS, 1)
    parts = [_part(grid, k, step) for k, grid in enumerate(data.train)]
    return _Rows(*(np.concatenate(some) for some in zip(*parts, strict=True)))


def _part(grid: ServoGrid, number: int, step: int) -> tuple[Array, Array, Array, Array, Mask]:
    edge = min(int(EDGE * grid.rate), len(grid) // 4)
    use = np.arange(edge, len(grid) - edge, step)
    motion = motion_of(grid)
    error = grid.gain * (grid.command - motion.q)
    second = (use * grid.step).astype(int) // 2 + number
    held = np.where(grid.on[use] > 0.5, error[use], np.nan)
    return motion.q[use], held, motion.v[use], motion.a[use], second % 2 == 0


def _score(robot: Robot, rows: _Rows, signs: Array, zeros: Array) -> float:
    """Sum over joints of the log rms of the error on rows that took no part."""
    data = robot.model.createData()
    q = configuration(robot, signs * rows.q + zeros)
    load = np.array([pin.computeGeneralizedGravity(robot.model, data, x) for x in q]) @ robot.drive * signs
    return sum(_unseen(rows, load[:, j], j) for j in range(rows.q.shape[1]))


def _unseen(rows: _Rows, load: Array, j: int) -> float:
    known = np.isfinite(rows.error[:, j])
    y, half = rows.error[known, j], rows.half[known]
    v, a, load = rows.v[known, j], rows.a[known, j], load[known]
    x = np.column_stack([v, np.tanh(v / 0.05), a, np.ones_like(v)])
    if min(half.sum(), (~half).sum()) < 20 or not y.any():
        return 0.0
    both = np.column_stack([x, load])
    found = np.linalg.lstsq(both[half], y[half], rcond=None)[0]
    if found[-1] < 0:  # a drive does not push along its load
        both, found = x, np.linalg.lstsq(x[half], y[half], rcond=None)[0]
    left = y[~half] - both[~half] @ found
    return float(np.log(max(np.sqrt(np.mean(left**2)), 1e-6)))
