"""Instrumental variables: the same columns along the motion of the simulated closed loop."""

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
    """IDIM-IV: instruments from a simulation know nothing of the encoders' noise, so that the estimate has no bias."""

    gains: Gains = None  # stiffness (n,) [N.m/rad] and damping (n,) [N.m.s/rad]; None: found in the recordings

    name, title = "iv", "instrumental variables"
    source = "Janot, Vandanjon, Gautier, A generic instrumental variable approach, IEEE T-CST 22(1), 2014"

    def options(self, options: Options) -> Options:
        """Positions alone; the desired ones drive the simulation."""
        return loop_options(options, self.name)

    def estimate(self, given: Given) -> Estimate:
        """Simulation with the parameters found, and estimate with its motion as instruments, in turn."""

        def solve(parts: list[Part]) -> Estimate:
            factors = given.reduce(parts, "instruments for", True)
            found = estimate(factors, given.base, given.prior, given.whiten, weakest=np.inf)
            if found.method == self.title:
                return replace(found, notes=())
            flag = "the motion of the simulated closed loop cannot tell all base parameters; least squares is kept"
            return replace(found, notes=(), flags=(flag,))

        return iterate(given, self.name, "q_des", solve, self.gains)


PLUGIN = InstrumentalVariables()
