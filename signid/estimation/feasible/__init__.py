"""From base parameters to standard parameters: those a real robot could have, or those nearest to the description.

A body is possible where its pseudo-inertia, a matrix of its mass, first moments and inertia, is positive definite.
"""

from .fit import ConsistentFit, fit_consistent
from .prior import standard_from_base

__all__ = ["ConsistentFit", "fit_consistent", "standard_from_base"]
