"""Ways to minimise, one library a file."""

from __future__ import annotations

from ..registry import Registry
from .base import Optimiser, Optimum, Problem

__all__ = ["OPTIMISERS", "Optimiser", "Optimum", "Problem"]
OPTIMISERS: Registry[Optimiser] = Registry("optimisers", __name__, "nlopt_ scipy_")
