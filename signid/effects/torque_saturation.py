"""Torque saturation: the amplifier limits the torque, but the command is recorded."""

import numpy as np

from ..types import Array, Shape, View
from .base import ActuatorLaw


class TorqueSaturation(ActuatorLaw):
    """Applied torque = command clipped to a limit."""

    name, equation = "torque_saturation", "clip(torque, -limit, limit)"
    source = "Astrom, Murray, Feedback Systems, Princeton University Press, 2008, section 10.4 (windup)"
    typical = "the effort limit of the description, or less at high temperature"
    parameters = {"limit": Shape("N.m", tuple(np.linspace(0.6, 4.0, 35).tolist()), of="torque")}
    example = {"limit": 42.0}

    def possible(self, x: View, limit: float) -> bool:
        """Whether the command often exceeds the limit by more than noise, and the torque of the motion hardly does."""
        beyond = np.abs(x.recorded) - limit
        noise = 8 * float(np.quantile(np.abs(x.recorded - x.torque), 0.1))  # residual of the samples without clipping
        often = np.sum(beyond > 0) >= 8 and np.sqrt(np.mean(np.maximum(beyond[beyond > 0], 0) ** 2)) > 3 * noise
        return bool(often and np.quantile(np.abs(x.torque), 0.99) < 1.2 * limit)

    def applied_torque(self, x: View, limit: float) -> Array:
        return np.clip(x.torque, -limit, limit)


PLUGIN = TorqueSaturation()
