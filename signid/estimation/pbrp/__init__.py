"""Standard parameters by penalty-based retrieval: global search in a box, physics as a penalty that grows.

It is the classical way (`signid identify --method pbrp`); the default, a convex fit, is in
`signid.estimation.feasible`.
"""

from .bounds import Bounds, bounds_around, read_bounds
from .search import Retrieval, Run, retrieve

__all__ = ["Bounds", "Retrieval", "Run", "bounds_around", "read_bounds", "retrieve"]
