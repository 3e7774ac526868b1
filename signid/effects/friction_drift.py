"""Friction drift: friction changes while the lubricant warms up."""

import numpy as np

from ..types import Array, Coefficient, Shape, View
from .base import TorqueLaw


class FrictionDrift(TorqueLaw):
    """Change of dry friction since the first sample of a session; a negative change alone is not dissipative.

    Recordings that are given together are one session, in their order.
    """

    name, equation = "friction_drift", "change * (1 - exp(-t / time_constant)) * sign(v)"
    source = (
        "Simoni, Beschi, Legnani, Visioli, Modelling the temperature in joint friction, doi 10.1017/S0263574717000509"
    )
    typical = "-30 to -50 % of cold friction within tens of minutes"
    changes = ("coulomb_friction", "asymmetric_friction", "presliding_friction")
    parameters = {"change": Coefficient("N.m"), "time_constant": Shape("s", (0.25, 0.5, 1.0), of="duration")}
    example = {"change": 2.0, "time_constant": 4.0}
    reverses = True

    def columns(self, x: View, time_constant: float) -> list[Array]:
        return [(1 - np.exp(-(x.t - x.origin) / time_constant)) * x.direction]


PLUGIN = FrictionDrift()
