"""Asymmetric friction: different friction in the two directions of motion."""

import numpy as np

from ..types import Array, Coefficient, View
from .base import TorqueLaw


class AsymmetricFriction(TorqueLaw):
    """Viscous and Coulomb friction per direction; beside symmetric friction or an offset, only differences count."""

    name = "asymmetric_friction"
    equation = (
        "where(v > 0, viscous_positive * v + coulomb_positive * sign(v),"
        " viscous_negative * v + coulomb_negative * sign(v))"
    )
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994, section 2"
    headline = "asymmetric friction of {joint}: {coulomb_positive} forwards, {coulomb_negative} backwards"
    typical = "a few per cent difference between the directions"
    contains = {
        "viscous_friction": {"viscous_positive": 1, "viscous_negative": 1},
        "coulomb_friction": {"coulomb_positive": 1, "coulomb_negative": 1},
        "torque_offset": {"coulomb_positive": 1, "coulomb_negative": -1},
    }
    parameters = {
        "viscous_positive": Coefficient("N.m.s/rad", positive=True),
        "viscous_negative": Coefficient("N.m.s/rad", positive=True),
        "coulomb_positive": Coefficient("N.m", positive=True),
        "coulomb_negative": Coefficient("N.m", positive=True),
    }
    example = {"viscous_positive": 2.0, "viscous_negative": 3.0, "coulomb_positive": 2.0, "coulomb_negative": 1.0}
    dissipative, reverses = True, True
    twins = ("torque_offset",)

    def columns(self, x: View) -> list[Array]:
        return [np.maximum(x.v, 0), np.minimum(x.v, 0), np.maximum(x.direction, 0), np.minimum(x.direction, 0)]


PLUGIN = AsymmetricFriction()
