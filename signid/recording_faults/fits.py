"""How much of a joint's torque a passive joint with the model's bodies explains."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..types import Array
from .evidence import Signals
from .nonnegative import nonnegative


class Fit(NamedTuple):
    """Torque = gain * predicted + friction + rotor + offset, nothing of it negative but the offset."""

    gain: float  # [1] of the predicted torque
    unexplained: float  # [1] share of the torque's variance
    residual: Array  # (K,) [N.m or N]
    power: float  # [N2.m2 or N2] variance of the torque


class Columns:
    """The columns of one joint, ready for many torques."""

    def __init__(self, x: Signals, joint: int, predicted: bool = True, rotor: bool = True) -> None:
        """Prediction, viscous and Coulomb friction and a rotor of a joint, or fewer of them."""
        use = [x.predicted] * predicted + [x.v, x.direction] + [x.a] * rotor
        columns = np.stack([signal[:, joint] for signal in use], axis=1)
        self.columns = columns - columns.mean(axis=0)
        self.size = np.maximum(np.linalg.norm(self.columns, axis=0), 1e-300)
        self.basis, self.factor = np.linalg.qr(self.columns / self.size)

    def fit(self, torque: Array) -> Fit:
        """The best fit.

        Args:
            torque: (K,) [N.m or N].
        """
        y = torque - torque.mean()
        found = nonnegative(self.factor, self.basis.T @ y) / self.size
        residual = y - self.columns @ found
        power = float(y @ y)
        share = float(residual @ residual) / power if power else 1.0
        return Fit(float(found[0]), share, residual, power / len(y))


def fit_joints(x: Signals) -> list[Fit]:
    """Every joint's torque by the joint's own columns."""
    return [Columns(x, j).fit(x.torque[:, j]) for j in range(x.torque.shape[1])]


def unexplained(x: Signals) -> Array:
    """(n,) [1] shares of the torques' variances."""
    return np.array([fit.unexplained for fit in fit_joints(x)])
