"""Backlash: the link moves freely within a gap of the gear."""

import numpy as np

from ..types import Array, Shape, View
from .base import TransmissionLaw
from .oscillation import fly

STOP_FREQUENCY = 500.0  # [rad/s] natural frequency of the link on its critically damped stops


class Backlash(TransmissionLaw):
    """No torque inside the gap, stiff stops at its ends; simulation requires an armature at the joint."""

    name = "backlash"
    equation = "inertia * (abs(q) > gap / 2) * (500**2 * (q - clip(q, -gap / 2, gap / 2)) + 1000 * v)"
    source = "Nordin, Gutman, Controlling mechanical systems with backlash, Automatica 38(10), 2002, pages 1633-1649"
    typical = "0.2 to 0.6 mrad in industrial gears, 5 to 20 mrad in servos"
    parameters = {"gap": Shape("rad", (0.001, 0.003, 0.006, 0.01, 0.02, 0.04))}
    example = {"gap": 0.02}

    def hold(self, x: View, gap: float) -> Array:
        pressed = x.q - np.clip(x.q, -gap / 2, gap / 2)
        return x.inertia * np.where(pressed == 0, 0, STOP_FREQUENCY**2 * pressed + 2 * STOP_FREQUENCY * x.v)

    def deflection(self, x: View, gap: float) -> list[Array]:
        return [fly(x, gap, STOP_FREQUENCY)]


PLUGIN = Backlash()
