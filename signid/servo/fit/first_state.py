"""State of a robot at the first row of a recording: the one from which the closed loop meets the next rows best."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...model import Model
from ...servos import Servo, ServoGrid
from ...types import Array
from ..plant.course import motion_of, part, recorded_course
from ..plant.drives import copies_of
from .normal import NUDGE, STATE, state_slopes
from .windows import FitWindows, shoot, windows_of

LENGTH = 0.2  # [s] rows that are compared; a start is forgotten within them
ROUNDS = 4  # of Gauss-Newton
SHARES = (0.0, 0.1, 0.3, 0.6, 1.0)  # of its step that are tried
LEAST = 1e-4  # [rad or m] least noise of positions


def first_state(model: Model, grid: ServoGrid) -> tuple[Array, Array]:
    """Positions (n,) [rad or m] and speeds (n,) [rad/s or m/s] of the first row.

    Smoothed positions have no right speed at the first row: a robot that begins to move there seems to move before.
    Driven joints have the state that a window of the fit would have (section 3 of `servo/README.md`).
    """
    motion, driven = motion_of(grid), [j for j, joint in enumerate(grid.joints) if joint in model.servos]
    q, v = motion.q[0].copy(), motion.v[0].copy()
    servos, n = [model.servos[grid.joints[j]] for j in driven], len(driven)
    rows = min(int(round(LENGTH * grid.rate)), len(grid) - 1)
    windows = windows_of([grid], driven, servos, [part(recorded_course(model, grid), driven)], [(0, 0, rows)])
    smoothed, wide, nudges = np.concatenate([q[driven], v[driven]]), np.repeat(STATE, n), np.repeat(NUDGE, n)
    at, noise = smoothed, np.zeros(n)
    for k in range(ROUNDS):
        found = _positions(windows, servos, at + np.vstack([np.zeros(2 * n), np.diag(nudges)]))
        left = found[0] - windows.measured
        if k == 0:
            noise = np.maximum(np.sqrt(np.mean(left**2, axis=(0, 1))), LEAST)
        slopes = state_slopes((found[1:] - found[0]) / nudges[:, None, None, None], noise)
        step = slopes.inverse[0] @ (slopes.slopes[0].T @ (left / noise).ravel() + (at - smoothed) / wide**2)
        tried = at - np.array(SHARES)[:, None] * step
        misfit = np.sum(((_positions(windows, servos, tried) - windows.measured) / noise) ** 2, axis=(1, 2, 3))
        at = tried[np.argmin(misfit + np.sum(((tried - smoothed) / wide) ** 2, axis=1))]
    q[driven], v[driven] = at[:n], at[n:]
    return q, v


def _positions(windows: FitWindows, servos: Sequence[Servo], states: Array) -> Array:
    """Positions (C, 1, T, n) [rad or m] from C states (C, 2n): positions first, then speeds."""
    starts = states[:, None, : len(servos)], states[:, None, len(servos) :]
    return shoot(windows, copies_of([servos] * len(states)), *starts)[0]
