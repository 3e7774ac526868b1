"""Limits of torque to start from, by simulating short windows at many of them with all other numbers fixed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...model import Model
from ...servos import Servo, ServoGrid
from ...types import Array
from ..plant.course import bodies_of, groups, part, recorded_course
from ..plant.drives import copies_of
from ..plant.kernel import EFFORT
from .windows import shoot, window_places, windows_of

SHARES = tuple(0.95 * 0.78**k for k in range(12))  # of the largest torque, where a limit is tried
WINDOW = 0.2  # [s]: nearly linear


def start_limits(
    model: Model, grids: Sequence[ServoGrid], servos: Mapping[str, Servo], top: Mapping[str, float]
) -> dict[str, float]:
    """Limit of each joint in `top` that fits its windows best, of its first share where none helps.

    Args:
        model: bodies and laws of the robot.
        grids: recordings, all of the same joints and one rate.
        servos: drives by joint.
        top: largest torque by joint [N.m or N].
    """
    robot, found = bodies_of(model, grids[0].joints), {}
    acting = [j for j, joint in enumerate(grids[0].joints) if joint in servos]
    for joints in groups(robot, acting):
        names = [grids[0].joints[j] for j in joints]
        if any(name in top for name in names):
            squares = _squares(model, grids, joints, [servos[name] for name in names], [top.get(n) for n in names])
            best = np.argmin(squares, axis=0)
            found.update({n: SHARES[k] * top[n] for n, k in zip(names, best, strict=True) if n in top})
    return found


def _squares(
    model: Model,
    grids: Sequence[ServoGrid],
    joints: Sequence[int],
    drives: Sequence[Servo],
    top: Sequence[float | None],
) -> Array:
    """Mean squares (K, n) [rad2 or m2] of the joints of a branch at K shares of their largest torques."""
    copies = copies_of([drives] * len(SHARES))
    for i, most in enumerate(top):
        if most is not None:
            copies.numbers[:, i, EFFORT] = most * np.array(SHARES)
    along = [part(recorded_course(model, grid), joints) for grid in grids]
    windows = windows_of(grids, joints, drives, along, window_places(grids, WINDOW))
    q0, v0 = (np.repeat(x[None], len(SHARES), 0) for x in (windows.q0, windows.v0))
    error = shoot(windows, copies, q0, v0)[0] - windows.measured
    return np.asarray(np.nan_to_num(error**2, nan=np.inf).sum(axis=(1, 2)) / windows.inside.sum())
