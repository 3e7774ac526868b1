"""Coulomb friction: dry friction, independent of speed."""

from ..types import Array, Coefficient, View
from .base import TorqueLaw


class CoulombFriction(TorqueLaw):
    """Constant torque against the direction of motion; any torque up to this level at rest."""

    name, equation = "coulomb_friction", "level * sign(v)"
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994, section 2"
    headline = "Coulomb friction of {joint}: {level}"
    typical = "0.2 to 0.5 N.m (Panda), 0.3 to 9 (TX40), 2 to 14 (UR10E); 2 to 20 % of the rated torque"
    parameters = {"level": Coefficient("N.m", positive=True)}
    example = {"level": 3.0}
    dissipative, reverses, usual = True, True, True

    def columns(self, x: View) -> list[Array]:
        return [x.direction]


PLUGIN = CoulombFriction()
