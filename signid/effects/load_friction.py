"""Load-dependent friction: gear friction that grows with the transmitted torque."""

import numpy as np

from ..types import Array, Coefficient, View
from .base import TorqueLaw


class LoadFriction(TorqueLaw):
    """Dry friction proportional to the torque that the gear transmits to the link."""

    name, equation = "load_friction", "coefficient * abs(load) * sign(v)"
    source = "Duclusaud, Passault, Padois, Ly, Extended friction models for servo actuators, arXiv 2410.08650, model M3"
    headline = "friction of {joint} proportional to load: {coefficient}"
    typical = "0.06 to 0.13 (UR10E), up to 0.5 in servo actuators"
    parameters = {"coefficient": Coefficient("1", positive=True)}
    example = {"coefficient": 0.12}
    dissipative, reverses = True, True

    def columns(self, x: View) -> list[Array]:
        return [np.abs(x.load) * x.direction]


PLUGIN = LoadFriction()
