"""Spring: an elastic element between a link and its parent."""

from collections.abc import Sequence

import numpy as np

from ..types import Array, Coefficient, View
from .base import Numbers, TorqueLaw


class Spring(TorqueLaw):
    """Torque proportional to the displacement from rest; a constant column represents the rest position."""

    name, equation = "spring", "stiffness * (q - rest)"
    source = "Wang, Gondokaryono, Munawar, Fischer, Identification of the da Vinci Research Kit, IEEE RA-L 4(4), 2019"
    typical = "up to 30 N.m/rad"
    parameters = {"stiffness": Coefficient("N.m/rad", positive=True), "rest": Coefficient("rad")}
    regressors = {"stiffness": Coefficient("N.m/rad", positive=True), "torque_at_zero": Coefficient("N.m")}
    example = {"stiffness": 8.0, "rest": 0.3}

    def columns(self, x: View) -> list[Array]:
        return [x.q, np.ones_like(x.q)]

    def coefficients(self, parameters: Numbers) -> list[float]:
        return [parameters["stiffness"], -parameters["stiffness"] * parameters["rest"]]

    def physical(self, coefficients: Sequence[float], shape: Numbers) -> dict[str, float]:
        stiffness, constant = map(float, coefficients)
        return {"stiffness": stiffness, "rest": -constant / stiffness if stiffness else 0.0}


PLUGIN = Spring()
