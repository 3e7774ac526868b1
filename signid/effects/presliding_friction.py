"""Presliding friction (Dahl): surfaces stick as if by springs before they slide."""

import numpy as np

from ..types import Array, Coefficient, Shape, View
from .base import TorqueLaw


class PreslidingFriction(TorqueLaw):
    """Memory: z in [-1, 1], the part of the sliding torque that the bent asperities hold."""

    name, equation = "presliding_friction", "level * z; dz/dt = v / distance * (1 - z * sign(v))"
    source = "Dahl's model, in Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE Trans. Automatic Control 40(3), 1995"
    typical = "distance 1e-4 to 1e-2 rad, level that of Coulomb friction, which it stands for"
    common, approximate = 0.3, True
    parameters = {
        "level": Coefficient("N.m", positive=True),
        "distance": Shape("rad", (0.03, 0.06, 0.12, 0.2), of="travel"),
    }
    example = {"level": 4.0, "distance": 0.05}
    twins = ("coulomb_friction",)
    memory = True

    def advance(self, z: Array, x: View, distance: float) -> Array:
        """Exact while the velocity is constant: towards its sign within the distance.

        Args:
            z: (..., m) [1].
            x: the joints.
            distance: of the bend [rad or m].
        """
        end = np.sign(x.v)
        return np.asarray(end + (z - end) * np.exp(-np.abs(x.v) * x.dt / distance))

    def columns(self, x: View, z: Array, distance: float) -> list[Array]:
        """The memory itself, z: (..., m) [1]."""
        return [z]


PLUGIN = PreslidingFriction()
