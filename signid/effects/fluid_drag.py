"""Fluid drag: quadratic drag on the last link, in water or from cloth."""

import numpy as np

from ..types import Array, Coefficient, View
from .base import TorqueLaw


class FluidDrag(TorqueLaw):
    """Force against the velocity of the last link's centre of mass, proportional to the square of its speed."""

    name, equation = "fluid_drag", "jacobian.T @ (coefficient * (jacobian @ v) * norm(jacobian @ v))"
    source = "Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, Wiley, 2011"
    typical = "half the density times area times drag coefficient: 5 to 50 N.s2/m2 in water, under 0.1 in air"
    parameters = {"coefficient": Coefficient("N.s2/m2", positive=True)}
    example = {"coefficient": 6.0}
    scope = "robot"
    dissipative = True
    twins = ("quadratic_friction",)

    def columns(self, x: View) -> list[Array]:
        jacobian = x.whole.jacobian
        w = np.einsum("...ij,...j->...i", jacobian, x.v)
        return [np.einsum("...ij,...i->...j", jacobian, w * np.linalg.norm(w, axis=-1, keepdims=True))]


PLUGIN = FluidDrag()
