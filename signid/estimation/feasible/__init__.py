"""Base parameters -> standard parameters: physically feasible ones, or those nearest to the description.

A body is feasible if its pseudo-inertia, a matrix of its mass, first moments and inertia, is positive definite.
"""

from .fit import ConsistentFit, fit_consistent, standard_from_base

__all__ = ["ConsistentFit", "fit_consistent", "standard_from_base"]
