"""Coulomb friction: dry surfaces resist with one torque whatever the speed."""

from ..types import Array, Coefficient, View
from .base import TorqueLaw


class CoulombFriction(TorqueLaw):
    """A constant level against the direction of motion; typically 2 to 20 % of the rated torque."""

    name, equation = "coulomb_friction", "level * sign(v)"
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994, section 2"
    parameters = {"level": Coefficient("N.m", positive=True)}
    example = {"level": 3.0}
    dissipative, reverses = True, True

    def columns(self, x: View) -> list[Array]:
        """Direction of motion, (..., m) [1]."""
        return [x.direction]


PLUGIN = CoulombFriction()
