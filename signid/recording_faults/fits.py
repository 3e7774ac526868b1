"""Fit of a joint's torque by a passive joint with the model's bodies, or with a law that the model lacks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..regression.projection import leave
from ..robot.dynamics import own_body
from ..types import INERTIAL, Array, Mask
from .evidence import Correction, FaultEvidence, Signals

ROUNDING = 1e-12  # [1] rounding error over the largest number


class ColumnFit(NamedTuple):
    """Fit: torque = gain * predicted + friction + rotor + offset, with non-negative coefficients except the offset."""

    gain: float  # [1] factor on the predicted torque
    unexplained: float  # [1] residual variance over the torque's variance
    residual: Array  # (K,) [N.m or N]
    power: float  # [N2.m2 or N2] variance of the torque


class FitColumns:
    """Columns of one joint, factorised for fits of several torques."""

    def __init__(self, x: Signals, joint: int, predicted: bool = True, rotor: bool = True) -> None:
        """Build the columns: predicted torque, viscous and Coulomb friction, and rotor of a joint."""
        use = [x.predicted] * predicted + [x.v, x.direction] + [x.a] * rotor
        columns = np.stack([signal[:, joint] for signal in use], axis=1)
        self.columns = columns - columns.mean(axis=0)
        self.size = np.maximum(np.linalg.norm(self.columns, axis=0), 1e-300)
        self.basis, self.factor = np.linalg.qr(self.columns / self.size)

    def fit(self, torque: Array) -> ColumnFit:
        """Fit torque: (K,) [N.m or N] by non-negative least squares."""
        y = torque - torque.mean()
        found = nonnegative(self.factor, self.basis.T @ y) / self.size
        residual, power = y - self.columns @ found, float(y @ y)
        share = float(residual @ residual) / power if power else 1.0
        return ColumnFit(float(found[0]), share, residual, power / len(y))


def fit_joints(x: Signals) -> list[ColumnFit]:
    """Fits of all joints' torques by their own columns."""
    return [FitColumns(x, j).fit(x.torque[:, j]) for j in range(x.torque.shape[1])]


def unexplained(x: Signals) -> Array:
    """Unexplained shares (n,) [1] of the torques' variances."""
    return np.array([fit.unexplained for fit in fit_joints(x)])


def missing_laws(evidence: FaultEvidence) -> Iterator[tuple[str, Array]]:
    """Each kind of missing law, in words, and the shares (n,) [1] of the torques' variances that it leaves.

    Friction, rotor and offset of every joint may have any size and sign, since a simulation may state too much of them.
    Beside these, all ten numbers of the body that one joint moves may be others: a payload, a counterbalance, a wrong
    link.
    """
    x, count, joints = evidence.plain, len(evidence.q), np.flatnonzero(evidence.signed)
    own = [np.stack([np.ones(count), x.v[:, j], x.direction[:, j], x.a[:, j]], axis=1) for j in joints]
    size = np.maximum(np.std(x.torque, axis=0), 1e-300)
    y = [leave((x.torque - x.predicted)[:, j], own[k]) / size[j] for k, j in enumerate(joints)]
    shares = np.ones(len(size))
    shares[joints] = np.mean(np.square(y), axis=1)
    yield "friction or a rotor of another size", shares
    bodies = evidence.along(Correction.none(len(size))).bodies.reshape(count, len(size), -1, len(INERTIAL))
    for moved, joint in enumerate(evidence.robot.joints):
        columns = bodies[:, :, own_body(evidence.robot, moved)]
        beyond = [leave(columns[:, j], own[k]) / size[j] for k, j in enumerate(joints)]
        rest = leave(np.concatenate(y), np.concatenate(beyond)).reshape(len(joints), count)
        shares = shares.copy()
        shares[joints] = np.mean(rest**2, axis=1)
        yield f"another body than stated at the link that {joint} moves", shares


def nonnegative(matrix: Array, target: Array) -> Array:
    """Non-negative least-squares coefficients (k,); matrix: (m, k) columns, target: (m,) [any units].

    Source: Lawson, Hanson, Solving Least Squares Problems, 1974, chapter 23.
    """
    gram, right = matrix.T @ matrix, matrix.T @ target
    gram.ravel()[:: len(right) + 1] += ROUNDING * gram.max(initial=0.0)  # columns may be equal
    x, free = np.zeros(len(right)), np.zeros(len(right), dtype=bool)
    least = ROUNDING * float(np.abs(right).max(initial=0.0))
    for _ in range(3 * len(right)):
        slope = np.where(free, -np.inf, right - gram @ x)
        if free.all() or slope.max() <= least:
            break
        free[int(np.argmax(slope))] = True
        x, free = _feasible(gram, right, x, free)
    return x


def _feasible(gram: Array, right: Array, x: Array, free: Mask) -> tuple[Array, Mask]:
    """Solution over free coefficients; those that would be negative are fixed at zero, one after another."""
    while free.any():
        new = np.zeros(len(x))
        new[free] = np.linalg.solve(gram[free][:, free], right[free])
        if np.all(new[free] > 0):
            return new, free
        falls = np.asarray(free & (new <= 0))
        step = float(np.min(x[falls] / np.maximum(x[falls] - new[falls], 1e-300)))
        x = x + step * (new - x)
        free = np.asarray(free & (x > ROUNDING * np.abs(x).max(initial=0.0)))
        x = np.where(free, x, 0.0)
    return np.zeros(len(x)), free
