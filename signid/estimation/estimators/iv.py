"""Instrumental variables: regressor columns along the motion of the simulated closed loop."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...regression.session import Options, Part
from ...types import Estimate, Frozen
from ..least_squares import estimate
from .base import Estimator, Given
from .loop import Gains, iterate, loop_options


@dataclass(frozen=True, eq=False)
class InstrumentalVariables(Frozen, Estimator):
    """IDIM-IV: simulated instruments are independent of the encoder noise, so the estimate has no bias from it."""

    gains: Gains = None  # stiffness (n,) [N.m/rad] and damping (n,) [N.m.s/rad]; None: estimated from the recordings

    name, title = "iv", "instrumental variables"
    source = "Janot, Vandanjon, Gautier, A generic instrumental variable approach, IEEE T-CST 22(1), 2014"

    def options(self, options: Options) -> Options:
        """Options without recorded derivatives and instruments; desired positions drive the simulation."""
        return loop_options(options, self.name)

    def estimate(self, given: Given) -> Estimate:
        """Alternate between simulation with the current parameters and estimation with its motion as instruments."""

        def solve(parts: list[Part]) -> Estimate:
            factors = given.reduce(parts, "instruments for", True)
            found = estimate(factors, given.base, given.prior, given.whiten, weakest=np.inf)
            if found.method == self.title:
                return replace(found, notes=())
            flag = (
                "some base parameters are not identifiable from the motion of the simulated closed loop; the "
                "least-squares estimate is kept"
            )
            return replace(found, notes=(), flags=(flag,))

        return iterate(given, self.name, "q_des", solve, self.gains)


PLUGIN = InstrumentalVariables()
