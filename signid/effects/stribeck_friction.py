"""Stribeck friction: additional friction at low speed, before the oil film builds up."""

import numpy as np

from ..types import Array, Coefficient, Shape, View
from .base import TorqueLaw


class StribeckFriction(TorqueLaw):
    """Dry friction that decays with speed; with Coulomb and viscous friction it forms the Stribeck curve."""

    name, equation = "stribeck_friction", "level * exp(-((v / velocity) ** 2)) * sign(v)"
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994, section 2"
    headline = "Stribeck friction of {joint}: {level}"
    typical = "level 0.2 to 1 times that of Coulomb friction, velocity 0.01 to 0.2 rad/s"
    parameters = {"level": Coefficient("N.m", positive=True), "velocity": Shape("rad/s", (0.12, 0.25, 0.5), of="speed")}
    example = {"level": 3.0, "velocity": 0.3}
    dissipative, reverses = True, True

    def columns(self, x: View, velocity: float) -> list[Array]:
        return [np.exp(-((x.v / velocity) ** 2)) * x.direction]


PLUGIN = StribeckFriction()
