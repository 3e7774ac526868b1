"""Quadratic friction: friction of the lubricant proportional to the square of speed."""

import numpy as np

from ..types import Array, Coefficient, View
from .base import TorqueLaw


class QuadraticFriction(TorqueLaw):
    """Square of the velocity against its direction; adds curvature to viscous friction."""

    name, equation = "quadratic_friction", "coefficient * v * abs(v)"
    source = "Bittencourt, Gunnarsson, ASME J. Dynamic Systems, Measurement, and Control 134(5), 2012"
    typical = "up to 10 % of the friction at full speed; negative for shear-thinning grease"
    parameters = {"coefficient": Coefficient("N.m.s2/rad2")}
    example = {"coefficient": 1.5}
    dissipative = True
    twins = ("fluid_drag",)

    def columns(self, x: View) -> list[Array]:
        return [x.v * np.abs(x.v)]


PLUGIN = QuadraticFriction()
