"""Joint elasticity: a compliant gear, so the link deflects from the motor under load."""

from collections.abc import Iterator

import numpy as np

from ..types import Array, Shape, View
from .base import TransmissionLaw
from .oscillation import oscillate

RELAXATION_TIME = 1e-3  # [s] ratio of damping to stiffness
RESONANCES = (*np.geomspace(2, 16, 23), 20.0, 26.0, 35.0, 50.0, 80.0)  # [Hz] candidates, visible near resonance


class JointElasticity(TransmissionLaw):
    """Damped spring between motor and link, exact also at resonance; simulation requires an armature at the joint."""

    name, equation = "joint_elasticity", "stiffness * (q + 0.001 * v)"
    source = "Spong, Modeling and control of elastic joint robots, ASME J. Dyn. Sys. Meas. Control 109(4), 1987"
    typical = "1e4 to 1e5 N.m/rad for harmonic drives, 1e3 for light arms"
    parameters = {"stiffness": Shape("N.m/rad", ())}
    example = {"stiffness": 3000.0}
    twins = ("armature",)

    def hold(self, x: View, stiffness: float) -> Array:
        return stiffness * (x.q + RELAXATION_TIME * x.v)

    def deflection(self, x: View, stiffness: float) -> list[Array]:
        return [oscillate(x, stiffness, RELAXATION_TIME * stiffness)]

    def shapes(self, x: View) -> Iterator[dict[str, float]]:
        """Stiffnesses with resonance frequencies within and above the usual bandwidth."""
        inertia = float(np.mean(x.inertia))
        yield from ({"stiffness": inertia * (2 * np.pi * float(f)) ** 2} for f in RESONANCES)


PLUGIN = JointElasticity()
