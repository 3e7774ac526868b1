"""From base parameters to standard parameters: those a real robot could have, or those nearest to the description."""

from .fit import ConsistentFit, fit_consistent
from .nearest import standard_from_base

__all__ = ["ConsistentFit", "fit_consistent", "standard_from_base"]
