"""Torque offset: a constant that a sensor or an amplifier adds."""

import numpy as np

from ..types import Array, Coefficient, View
from .base import TorqueLaw


class TorqueOffset(TorqueLaw):
    """The same at every moment; also what an asymmetric Coulomb friction leaves."""

    name, equation = "torque_offset", "offset"
    source = "Swevers, Verdonck, De Schutter, Dynamic model identification, IEEE Control Systems 27(5), 2007"
    typical = "up to some per cent of the rated torque"
    parameters = {"offset": Coefficient("N.m")}
    example = {"offset": 1.0}
    twins = ("asymmetric_friction",)
    usual = True

    def columns(self, x: View) -> list[Array]:
        """One, (..., m) [1]."""
        return [np.ones_like(x.q)]


PLUGIN = TorqueOffset()
