"""Presliding friction (Dahl): elastic sticking before sliding."""

import numpy as np

from ..types import Array, Coefficient, Shape, View
from .base import TorqueLaw


class PreslidingFriction(TorqueLaw):
    """State z in [-1, 1]: the fraction of the sliding torque that the deflected asperities transmit."""

    name, equation = "presliding_friction", "level * z; dz/dt = v / distance * (1 - z * sign(v))"
    source = "Dahl's model, in Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE Trans. Automatic Control 40(3), 1995"
    typical = "distance 1e-4 to 1e-2 rad, level of Coulomb friction, which it replaces"
    common, approximate = 0.3, True
    parameters = {
        "level": Coefficient("N.m", positive=True),
        "distance": Shape("rad", (0.03, 0.06, 0.12, 0.2), of="travel"),
    }
    example = {"level": 4.0, "distance": 0.05}
    twins = ("coulomb_friction",)
    memory = True

    def advance(self, z: Array, x: View, distance: float) -> Array:
        """Relax z towards the sign of the velocity, exact for constant velocity.

        Args:
            z: (..., m) state [1].
            x: view of the joint.
            distance: relaxation distance [rad or m].
        """
        end = np.sign(x.v)
        return np.asarray(end + (z - end) * np.exp(-np.abs(x.v) * x.dt / distance))

    def columns(self, x: View, z: Array, distance: float) -> list[Array]:
        """The state, z: (..., m) [1]."""
        return [z]


PLUGIN = PreslidingFriction()
