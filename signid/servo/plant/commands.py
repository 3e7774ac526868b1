"""Commands in force on every substep: held from row to row, delayed, and limited by the profile of the firmware."""

from __future__ import annotations

import numpy as np
from numba import njit

from ...servos import ServoGrid
from ...types import Array

LARGE = 0.5  # first error over the rms error, from which it is a step (mauicv: .8 to 2.5) and no droop (XL330: 0)
STILL, LEFT, START = 0.02, 0.05, 0.15  # over the first error: motion at rest, and motion within START [s] that ends it


def commands_at(grid: ServoGrid, joint: int, kd_on: str, delay: float, profile: float, parts: int) -> Array:
    """Command, its speed and feed-forward averaged over each substep, and how they change in it (7, N parts).

    Rows 0 to 2 are averages, continuous in the delay; 3 to 5 what acts first in a substep less what acts afterwards;
    6 the share of the substep that the first takes.
    joint: column of the grid; kd_on: one of KD_ON; delay [s]; profile: largest speed of the command [rad/s or m/s];
    parts: substeps of a row.
    """
    held = np.zeros((7, len(grid) * parts))
    u, h = np.repeat(grid.command[:, joint], parts), grid.step / parts
    if np.isfinite(profile):
        limit(u, np.repeat(grid.q[:, joint], parts), np.repeat(grid.on[:, joint], parts), profile * h)
    late = max(delay, 0.0) / h
    held[6] = late - np.floor(late)
    held[0], held[3] = _delayed(u, late, held_before(grid, joint))
    if kd_on == "error":
        held[1], held[4] = _delayed(np.repeat(command_speed(grid, joint), parts), late)
    if grid.feed_forward is not None:
        held[2], held[5] = _delayed(np.repeat(grid.feed_forward[:, joint], parts), late)
    return held


def command_speed(grid: ServoGrid, joint: int) -> Array:
    """Speed of the command (N,) [rad/s or m/s] as recorded, else from row to row."""
    if grid.command_speed is not None:
        return grid.command_speed[:, joint]
    return np.diff(grid.command[:, joint], prepend=grid.command[0, joint]) * grid.rate


def held_before(grid: ServoGrid, joint: int) -> float:
    """Command in force before the first row [rad or m]: the first one, or the position where a drive starts from rest.

    A drive whose joint is at rest in the first two rows, far from its first command, and leaves for it soon after held
    its position until then.
    """
    q, first = grid.q[:, joint], float(grid.command[0, joint])
    error = first - float(q[0])
    moved = (q[: int(round(START * grid.rate)) + 2] - q[0]) * np.sign(error)
    large = abs(error) > LARGE * np.sqrt(np.mean((grid.command[:, joint] - q) ** 2))
    starts = large and abs(moved[1]) < STILL * abs(error) and moved.max() > LEFT * abs(error)
    return float(q[0]) if starts else first


def _delayed(u: Array, steps: float, first: float | None = None) -> tuple[Array, Array]:
    """Averages over each step of a signal that is held from step to step and acts `steps` later, and its falls.

    A fall is what acts first in a step less what acts afterwards. `first` acts before the signal.
    """
    first = u[0] if first is None else first
    whole = int(np.floor(steps))
    share = steps - whole
    late = np.concatenate([np.full(min(whole + 1, len(u)), first), u])
    start = max(whole + 1 - len(u), 0)  # longer than the recording
    now = late[1 : 1 + len(u)] if not start else np.full(len(u), first)
    before = late[: len(u)] if not start else now
    return np.asarray((1.0 - share) * now + share * before), np.asarray(before - now)


@njit(cache=True)
def limit(u, q, on, most):  # type: ignore[no-untyped-def]
    """Limit the change of a command to `most` a step, in place; it follows the position while the drive is off."""
    state = q[0]
    for k in range(len(u)):
        if on[k] > 0.5:
            state += min(max(u[k] - state, -most), most)
        else:
            state = q[k]
        u[k] = state
