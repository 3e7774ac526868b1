"""Blocks -> frames of 20 ms: residual torque, the columns of possible changes, and the error of the model there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..model import Model
from ..robot.dynamics import own_body
from ..types import Array
from .observer import Momentum, Residual

FRAME_DURATION = 0.02  # [s] duration of a frame
JOINT_COLUMNS = ("viscous_friction", "coulomb_friction", "torque_gain", "torque_offset")  # then the payload
PAYLOAD_COLUMNS = ("mass", "first_moment_x", "first_moment_y", "first_moment_z")
LINK_COLUMNS = 10  # columns of the last link: PAYLOAD_COLUMNS, then its inertia
FRAME_COLUMNS = len(JOINT_COLUMNS) + LINK_COLUMNS
UNSEEN_ERROR_RATIO = 1.0  # [1] error over value of a base parameter that the identification could not see


class Frames(NamedTuple):
    """F frames of n joints."""

    t: Array  # (F,) [s] end of each frame
    residual: Array  # (F, n) [N.m or N]
    columns: Array  # (F, n, 14) [N.m or N per unit]: JOINT_COLUMNS, then those of the last link
    usable: Array  # (F, n) [1] False where the direction of friction is uncertain
    moving: Array  # (F, n) [1] whether it is faster than that
    errors: Array  # (F, n, b) [N.m or N] of the predicted torque by each error of the model of one standard deviation
    std: Array  # (F, n) [N.m or N] of the predicted torque by all of them
    blocks: int  # blocks of a frame


class Framer:
    """Blocks that wait for their frame, and the factor of the model's covariance."""

    def __init__(self, model: Model, momentum: Momentum) -> None:
        self.momentum, self.robot = momentum, model.robot
        self.tip = own_body(model.robot, len(model.robot.joints) - 1)
        self.factor, self.friction = _factor(model)
        self.waiting: list[Array] = []
        self.blocks = 0

    def narrow(self, spread: Array) -> None:
        """Errors of the model from now on, as the quiet stretch left them.

        spread: (b, b) factor of their covariance [1].
        """
        self.factor = self.factor @ spread
        self.friction = [(rows, factors @ spread) for rows, factors in self.friction]

    def restart(self) -> None:
        """Begin a new stretch."""
        self.waiting = []

    def frames(self, found: Residual) -> Frames | None:
        """Complete frames, with the blocks that waited."""
        motion = found.motion
        n = motion.q.shape[1]
        if not self.blocks:
            step = float(np.diff(motion.t).mean()) if len(motion.t) > 1 else FRAME_DURATION
            self.blocks = max(1, round(FRAME_DURATION / max(step, 1e-9)))
        signals = (motion.q, motion.v, motion.a, motion.direction, found.predicted, found.residual, found.near)
        table = np.column_stack([motion.t, *signals])
        if self.waiting:
            table = np.concatenate([*self.waiting, table])
        count = len(table) // self.blocks
        self.waiting = [table[count * self.blocks :]]
        if not count:
            return None
        whole = table[: count * self.blocks].reshape(count, self.blocks, -1)
        mean = whole.mean(axis=1)
        q, v, a, direction, predicted, residual, near = np.split(mean[:, 1:], 7, axis=1)
        bodies = self.momentum.regressor(q, v, a)
        columns = np.empty((count, n, FRAME_COLUMNS))
        for k, signal in enumerate((v, direction, predicted, np.ones_like(v))):
            columns[:, :, k] = signal
        columns[:, :, len(JOINT_COLUMNS) :] = bodies[:, :, self.tip]
        errors = self._errors(bodies, v, direction)
        std = np.linalg.norm(errors, axis=2)
        moving = np.abs(v) > self.momentum.slow
        return Frames(whole[:, -1, 0], residual, columns, near == 0, moving, errors, std, self.blocks)

    def _errors(self, bodies: Array, v: Array, direction: Array) -> Array:
        """Errors (F, n, b) of the predicted torque by the covariance of the model [N.m or N]."""
        count, n = v.shape
        errors = bodies.reshape(count, n, -1) @ self.factor
        for signal, (rows, factors) in zip((v, direction, np.ones_like(v)), self.friction, strict=False):
            errors[:, rows] += signal[:, rows, None] * factors
        return errors


def _factor(model: Model) -> tuple[Array, list[tuple[list[int], Array]]]:
    """Factor (10 nb, b) of the covariance of inertials, and those of viscous, Coulomb friction and offsets."""
    known = model.covariance
    if known is None or not len(known.values):
        return np.zeros((10 * len(model.robot.links), 0)), []
    matrix = np.array(known.matrix)
    lost = ~np.isfinite(np.diag(matrix))
    matrix[lost, :] = matrix[:, lost] = 0.0
    matrix[lost, lost] = (UNSEEN_ERROR_RATIO * known.values[lost]) ** 2
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    root = size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    whole = np.linalg.pinv(known.combination) @ root
    place = {label: k for k, label in enumerate(known.labels)}
    friction = []
    for name in ("viscous_friction", "coulomb_friction", "torque_offset"):
        rows = [j for j, number in enumerate(model.robot.numbers) if f"{name}_{number}" in place]
        factors = whole[[place[f"{name}_{model.robot.numbers[j]}"] for j in rows]]
        friction.append((rows, factors.reshape(len(rows), -1)))
    return whole[: 10 * len(model.robot.links)], friction
