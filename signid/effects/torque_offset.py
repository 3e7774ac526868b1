"""Torque offset: a constant error of a sensor or an amplifier."""

import numpy as np

from ..types import Array, Coefficient, View
from .base import TorqueLaw


class TorqueOffset(TorqueLaw):
    """Constant torque; also the asymmetric part of Coulomb friction."""

    name, equation = "torque_offset", "offset"
    source = "Swevers, Verdonck, De Schutter, Dynamic model identification, IEEE Control Systems 27(5), 2007"
    typical = "up to a few per cent of the rated torque"
    parameters = {"offset": Coefficient("N.m")}
    example = {"offset": 1.0}
    twins = ("asymmetric_friction",)
    usual = True

    def columns(self, x: View) -> list[Array]:
        return [np.ones_like(x.q)]


PLUGIN = TorqueOffset()
