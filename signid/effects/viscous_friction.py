"""Viscous friction: friction of lubricant and bearings proportional to speed."""

from ..types import Array, Coefficient, View
from .base import TorqueLaw


class ViscousFriction(TorqueLaw):
    """Proportional to velocity; typically 1 to 20 % of the rated torque at full speed."""

    name, equation = "viscous_friction", "coefficient * v"
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994, section 2"
    typical = "0.6 to 8 N.m.s/rad (TX40), 2 to 19 (UR10E)"
    parameters = {"coefficient": Coefficient("N.m.s/rad", positive=True)}
    example = {"coefficient": 2.0}
    dissipative, usual = True, True

    def columns(self, x: View) -> list[Array]:
        return [x.v]


PLUGIN = ViscousFriction()
