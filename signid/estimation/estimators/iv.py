"""Instrumental variables: regressor columns along the motion of the simulated closed loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...regression.session import Part
from ...types import Estimate
from ..least_squares import estimate
from . import Given
from .loop import LoopEstimator


@dataclass(frozen=True, eq=False)
class InstrumentalVariables(LoopEstimator):
    """IDIM-IV: simulated instruments are independent of the encoder noise, so the estimate has no bias from it."""

    name, title, simulated = "iv", "instrumental variables", "q_des"
    source = "Janot, Vandanjon, Gautier, A generic instrumental variable approach, IEEE T-CST 22(1), 2014"

    def solve(self, given: Given, parts: Sequence[Part]) -> Estimate:
        """Estimate with the simulated motion as instruments."""
        factors = given.reduce(parts, "instruments for", True)
        found = estimate(factors, given.base, given.prior, given.whiten, weakest=np.inf)
        flag = (
            "some base parameters are not identifiable from the motion of the simulated closed loop; the "
            "least-squares estimate is kept"
        )
        return replace(found, notes=(), flags=() if found.method == self.title else (flag,))


PLUGIN = InstrumentalVariables()
