"""Weighted least squares."""

from ...types import Estimate
from ..least_squares import estimate
from . import Estimator, Given


class WeightedLeastSquares(Estimator):
    """Least squares weighted by each joint's noise; biased if position noise reaches the columns."""

    name, title = "wls", "weighted least squares"
    source = "Gautier, Dynamic identification of robots with power model, IEEE ICRA 1997"

    def estimate(self, given: Given) -> Estimate:
        """Estimate from the factors, without any correction."""
        return estimate(given.factors, given.base, given.prior, given.whiten)


PLUGIN = WeightedLeastSquares()
