"""Commands in force on every substep: held from row to row, delayed, and limited by the profile of the firmware."""

from __future__ import annotations

import numpy as np
from numba import njit

from ...servos import ServoGrid
from ...types import Array


def commands_at(grid: ServoGrid, joint: int, kd_on: str, delay: float, profile: float, parts: int) -> Array:
    """Command, its speed and feed-forward (3, N parts) averaged over each substep; continuous in the delay.

    joint: column of the grid; kd_on: one of KD_ON; delay [s]; profile: largest speed of the command [rad/s or m/s];
    parts: substeps of a row.
    """
    held = np.zeros((3, len(grid) * parts))
    u, h = np.repeat(grid.command[:, joint], parts), grid.step / parts
    if np.isfinite(profile):
        limit(u, np.repeat(grid.q[:, joint], parts), np.repeat(grid.on[:, joint], parts), profile * h)
    late = max(delay, 0.0) / h
    held[0] = _delayed(u, late)
    if kd_on == "error":
        held[1] = _delayed(np.repeat(_speed(grid, joint), parts), late)
    if grid.feed_forward is not None:
        held[2] = _delayed(np.repeat(grid.feed_forward[:, joint], parts), late)
    return held


def _speed(grid: ServoGrid, joint: int) -> Array:
    if grid.command_speed is not None:
        return grid.command_speed[:, joint]
    return np.diff(grid.command[:, joint], prepend=grid.command[0, joint]) * grid.rate


def _delayed(u: Array, steps: float) -> Array:
    """Averages over each step of a signal that is held from step to step and acts `steps` later."""
    whole = int(np.floor(steps))
    share = steps - whole
    late = np.concatenate([np.full(min(whole + 1, len(u)), u[0]), u])
    start = max(whole + 1 - len(u), 0)  # longer than the recording: the first command all along
    now = late[1 : 1 + len(u)] if not start else np.full(len(u), u[0])
    return np.asarray((1.0 - share) * now + share * (late[: len(u)] if not start else now))


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
