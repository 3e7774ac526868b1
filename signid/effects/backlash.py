"""Backlash: the link is free to move within a gap that the motor must cross to push it."""

import numpy as np

from ..types import Array, Shape, View
from .base import TransmissionLaw
from .flight import fly

STOP = 500.0  # [rad/s] natural frequency of the link on its stops, which are damped critically


class Backlash(TransmissionLaw):
    """No torque inside the gap, stiff stops at its ends; to be simulated, the joint needs an armature."""

    name = "backlash"
    equation = "inertia * (abs(q) > gap / 2) * (500**2 * (q - clip(q, -gap / 2, gap / 2)) + 1000 * v)"
    source = "Nordin, Gutman, Controlling mechanical systems with backlash, Automatica 38(10), 2002, pages 1633-1649"
    typical = "0.2 to 0.6 mrad in industrial gears, 5 to 20 mrad in servos"
    parameters = {"gap": Shape("rad", (0.001, 0.003, 0.006, 0.01, 0.02, 0.04))}
    example = {"gap": 0.02}

    def hold(self, x: View, gap: float) -> Array:
        """Spring and damper of a stop, (..., m) [N.m or N]."""
        pressed = x.q - np.clip(x.q, -gap / 2, gap / 2)
        return x.inertia * np.where(pressed == 0, 0, STOP**2 * pressed + 2 * STOP * x.v)

    def deflection(self, x: View, gap: float) -> list[Array]:
        """Of the link between its stops, (N, 1) [rad or m]."""
        return [fly(x, gap, STOP)]


PLUGIN = Backlash()
