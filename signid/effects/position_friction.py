"""Position-dependent friction: an eccentric gear binds once or twice per revolution."""

import numpy as np

from ..types import Array, Coefficient, Shape, View
from .base import TorqueLaw, amplitude_phase, sine_cosine


class PositionFriction(TorqueLaw):
    """Periodic change of Coulomb friction; alone it would drive the joint over half of each period."""

    name, equation = "position_friction", "amplitude * sin(frequency * q + phase) * sign(v)"
    source = "Bittencourt, Wernholt, Sander-Tavallaey, Brogardh, An extended friction model, IEEE/RSJ IROS 2010"
    typical = "5 to 30 % of Coulomb friction, once or twice per revolution of the joint"
    common, approximate = 0.3, True
    changes = ("coulomb_friction", "asymmetric_friction", "presliding_friction")
    parameters = {
        "amplitude": Coefficient("N.m"),
        "phase": Coefficient("rad", same=True),
        "frequency": Shape("1/rad", (1.0, 2.0)),
    }
    example = {"amplitude": 1.0, "phase": 0.4, "frequency": 2.0}
    reverses = True
    coefficients, physical = sine_cosine, amplitude_phase

    def possible(self, x: View, frequency: float) -> bool:
        """Whether the travel exceeds a quarter period; over less, the law is close to Coulomb friction."""
        return bool(frequency * np.ptp(x.q) > np.pi / 2)

    def columns(self, x: View, frequency: float) -> list[Array]:
        return [np.sin(frequency * x.q) * x.direction, np.cos(frequency * x.q) * x.direction]


PLUGIN = PositionFriction()
