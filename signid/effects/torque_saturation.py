"""Torque saturation: the amplifier gives less than it is asked for, the request is written down."""

import numpy as np

from ..types import Array, Shape, View
from .base import ActuatorLaw


class TorqueSaturation(ActuatorLaw):
    """The torque that acts is the command within a limit."""

    name, equation = "torque_saturation", "clip(torque, -limit, limit)"
    source = "Astrom, Murray, Feedback Systems, Princeton University Press, 2008, section 10.4 (windup)"
    typical = "the effort limit of the description, or less when hot"
    parameters = {"limit": Shape("N.m", tuple(np.linspace(0.6, 2.2, 17).tolist()), of="torque")}
    example = {"limit": 42.0}

    def applied_torque(self, x: View, limit: float) -> Array:
        """Clipped."""
        return np.clip(x.torque, -limit, limit)


PLUGIN = TorqueSaturation()
