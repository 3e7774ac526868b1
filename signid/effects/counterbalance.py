"""Counterbalance: a weight or gas spring that compensates part of gravity."""

import numpy as np

from ..types import Array, Coefficient, View
from .base import TorqueLaw, amplitude_phase, sine_cosine


class Counterbalance(TorqueLaw):
    """Sine with one period per revolution, like the gravity torque of a link about a horizontal axis."""

    name, equation = "counterbalance", "amplitude * sin(q + phase)"
    source = "Wang, Gondokaryono, Munawar, Fischer, Identification of the da Vinci Research Kit, IEEE RA-L 4(4), 2019"
    typical = "half to all of the weight torque of the arm: tens to hundreds of N.m at a shoulder"
    parameters = {"amplitude": Coefficient("N.m"), "phase": Coefficient("rad")}
    regressors = {"sine": Coefficient("N.m"), "cosine": Coefficient("N.m")}
    example = {"amplitude": 5.0, "phase": 0.4}
    twins = ("base_tilt", "encoder_offset", "payload", "link_inertia")
    coefficients, physical = sine_cosine, amplitude_phase

    def columns(self, x: View) -> list[Array]:
        return [np.sin(x.q), np.cos(x.q)]


PLUGIN = Counterbalance()
