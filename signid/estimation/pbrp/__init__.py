"""Penalty-based retrieval of standard parameters: global search in a box with growing penalties on infeasibility.

This is the classical method (`signid identify --method pbrp`). The default, a convex fit, is in
`signid.estimation.feasible`.
"""

from .cost import Bounds, bounds_around, read_bounds
from .search import Retrieval, SearchRun, retrieve

__all__ = ["Bounds", "Retrieval", "SearchRun", "bounds_around", "read_bounds", "retrieve"]
