"""Joint elasticity: the gear gives way under load, so the link lags behind the motor."""

from collections.abc import Iterator

import numpy as np

from ..types import Array, Shape, View
from .base import TransmissionLaw
from .oscillation import oscillate

RELAXATION = 1e-3  # [s] damping over stiffness
RESONANCES = (*np.geomspace(2, 16, 23), 20.0, 26.0, 35.0, 50.0, 80.0)  # [Hz] tried: each shows only close by


class JointElasticity(TransmissionLaw):
    """A damped spring between motor and link, exact at resonance too; simulated, the joint needs an armature."""

    name, equation = "joint_elasticity", "stiffness * (q + 0.001 * v)"
    source = "Spong, Modeling and control of elastic joint robots, ASME J. Dyn. Sys. Meas. Control 109(4), 1987"
    typical = "1e4 to 1e5 N.m/rad with harmonic drives, 1e3 in light arms"
    parameters = {"stiffness": Shape("N.m/rad", ())}
    example = {"stiffness": 3000.0}
    twins = ("armature",)

    def hold(self, x: View, stiffness: float) -> Array:
        """Spring and damper."""
        return stiffness * (x.q + RELAXATION * x.v)

    def deflection(self, x: View, stiffness: float) -> list[Array]:
        """Of the link on its spring, (N, 1) [rad or m]."""
        return [oscillate(x, stiffness, RELAXATION * stiffness)]

    def shapes(self, x: View) -> Iterator[dict[str, float]]:
        """Stiffnesses at which the link would resonate within and above the usual band."""
        inertia = float(np.mean(x.inertia))
        yield from ({"stiffness": inertia * (2 * np.pi * float(f)) ** 2} for f in RESONANCES)


PLUGIN = JointElasticity()
