"""Baseline: plain loop over Pinocchio's regressor and normal equations with known base columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin
from scipy.linalg import cho_factor, cho_solve

from signid.types import BaseMap, Robot

from .job import SAMPLES, Array, Track


def plain(robot: Robot, base: BaseMap, effects: Sequence[str], track: Track, solve: bool = True) -> Callable[[], Array]:
    """Return a function that solves the job with known base columns and all rows in memory."""
    moves = [bool(row.any()) for row in robot.drive]
    still = [k + 1 for k, moving in enumerate(moves) if not moving]
    model = pin.buildReducedModel(robot.model, still, pin.neutral(robot.model)) if still else robot.model
    data, (q, v, a, tau), n = model.createData(), track, model.nv
    place = np.repeat(np.cumsum(moves) - 1, 10) * 10 + np.tile(np.arange(10), len(moves))
    rigid = [int(place[k]) for k in base.independent if base.labels[k].body is not None]
    others = [base.labels[k] for k in base.independent if base.labels[k].body is None]
    signals = {"armature": a, "viscous_friction": v, "coulomb_friction": np.sign(v), "torque_offset": np.ones_like(v)}
    whole, columns = np.empty((SAMPLES, n, 10 * n)), np.zeros((SAMPLES, n, base.rank))

    def run() -> Array:
        compute = pin.computeJointTorqueRegressor
        for i in range(SAMPLES):
            whole[i] = compute(model, data, q[i], v[i], a[i])
        if not solve:
            return whole
        columns[:, :, : len(rigid)] = whole[:, :, rigid]
        for k, label in enumerate(others, len(rigid)):
            columns[:, label.joint, k] = signals[effects[label.law or 0]][:, label.joint]
        x = columns.reshape(-1, base.rank)
        return np.asarray(cho_solve(cho_factor(x.T @ x), x.T @ tau.ravel()))

    return run
