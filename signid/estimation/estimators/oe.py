"""Closed-loop output error: the torque of the simulated closed loop is fitted to the recorded one."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ...regression.session import Options, Part
from ...types import Estimate, Frozen
from ..least_squares import estimate
from .base import Estimator, Given
from .loop import Gains, iterate, loop_options


@dataclass(frozen=True, eq=False)
class OutputErrorEstimator(Frozen, Estimator):
    """DIDIM: Gauss-Newton fit of the torque of the simulated closed loop.

    The controller makes the simulated motion nearly independent of the parameters, so the Jacobian is the regressor
    along this motion. Measured positions only give the initial state.
    """

    gains: Gains = None  # stiffness (n,) [N.m/rad] and damping (n,) [N.m.s/rad]; None: estimated from the recordings

    name, title = "oe", "closed-loop output error"
    source = "Gautier, Janot, Vandanjon, A new closed-loop output error method, IEEE T-CST 21(2), 2013"

    def options(self, options: Options) -> Options:
        """Options without recorded derivatives and instruments; desired positions drive the simulation."""
        return loop_options(options, self.name)

    def estimate(self, given: Given) -> Estimate:
        """Alternate between simulation with the current parameters and least squares along its motion."""

        def solve(parts: list[Part]) -> Estimate:
            found = estimate(given.reduce(parts, "learning along"), given.base, given.prior, given.whiten)
            return replace(found, method=self.title)

        return iterate(given, self.name, "q", solve, self.gains)


PLUGIN = OutputErrorEstimator()
