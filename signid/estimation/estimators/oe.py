"""Closed-loop output error: the torque of the simulated closed loop is fitted to the recorded one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ...regression.session import Part
from ...types import Estimate
from ..least_squares import estimate
from . import Given
from .loop import LoopEstimator


@dataclass(frozen=True, eq=False)
class OutputErrorEstimator(LoopEstimator):
    """DIDIM: Gauss-Newton fit of the torque of the simulated closed loop.

    The controller makes the simulated motion nearly independent of the parameters, so the Jacobian is the regressor
    along this motion. Measured positions only give the initial state.
    """

    name, title, simulated = "oe", "closed-loop output error", "q"
    source = "Gautier, Janot, Vandanjon, A new closed-loop output error method, IEEE T-CST 21(2), 2013"

    def solve(self, given: Given, parts: Sequence[Part]) -> Estimate:
        """Least squares along the simulated motion."""
        found = estimate(given.reduce(parts, "learning along"), given.base, given.prior, given.whiten)
        return replace(found, method=self.title)


PLUGIN = OutputErrorEstimator()
