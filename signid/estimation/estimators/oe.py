"""Closed-loop output error: simulated torque is fitted to what was recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ...regression.session import Options, Part
from ...types import Estimate, Frozen
from ..least_squares import estimate
from .base import Estimator, Given
from .loop import Gains, iterate, loop_options


@dataclass(frozen=True, eq=False)
class OutputErrorEstimator(Frozen, Estimator):
    """DIDIM: the robot is simulated in closed loop, and its torque, linear in the parameters, fitted by Gauss-Newton.

    The simulated motion hardly depends on the parameters, as the controller holds it; so the Jacobian is the regressor
    along it. Measured positions serve only for the first state.
    """

    gains: Gains = None  # stiffness (n,) [N.m/rad] and damping (n,) [N.m.s/rad]; None: found in the recordings

    name, title = "oe", "closed-loop output error"
    source = "Gautier, Janot, Vandanjon, A new closed-loop output error method, IEEE T-CST 21(2), 2013"

    def options(self, options: Options) -> Options:
        """Positions alone; the desired ones drive the simulation."""
        return loop_options(options, self.name)

    def estimate(self, given: Given) -> Estimate:
        """Simulation with the parameters found, and least squares along its motion, in turn."""

        def solve(parts: list[Part]) -> Estimate:
            found = estimate(given.reduce(parts, "learning along"), given.base, given.prior, given.whiten)
            return replace(found, method=self.title)

        return iterate(given, self.name, "q", solve, self.gains)


PLUGIN = OutputErrorEstimator()
