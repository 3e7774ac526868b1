"""Cable torque: a cable dressing that stiffens towards the ends of travel."""

from collections.abc import Sequence

import numpy as np

from ..types import Array, Coefficient, View
from .base import Numbers, TorqueLaw


class CableTorque(TorqueLaw):
    """Cubic about the centre of travel: four columns; the first two determine both parameters."""

    name, equation = "cable_torque", "cubic * (q - centre) ** 3"
    source = (
        "Lin, Sadeghi Esfahlani, Kazanzides, Zheng, Gravity compensation with nonlinear cable forces, IEEE RA-L 2019"
    )
    typical = "a few per cent of the rated torque at the ends of travel"
    common = 0.3
    parameters = {"cubic": Coefficient("N.m/rad3"), "centre": Coefficient("rad")}
    example = {"cubic": 6.0, "centre": 0.3}

    def columns(self, x: View) -> list[Array]:
        return [x.q**3, x.q**2, x.q, np.ones_like(x.q)]

    def coefficients(self, parameters: Numbers) -> list[float]:
        """Coefficients of the expanded cubic."""
        k, c = parameters["cubic"], parameters["centre"]
        return [k, -3 * k * c, 3 * k * c**2, -k * c**3]

    def physical(self, coefficients: Sequence[float], shape: Numbers) -> dict[str, float]:
        return {"cubic": float(coefficients[0]), "centre": float(-coefficients[1] / (3 * coefficients[0]))}


PLUGIN = CableTorque()
