"""Ways to minimise, one library a file: NLopt and SciPy behind one verb.

A `Problem` is an objective in a box, a start, and a gradient if there is one; `OPTIMISERS["nlopt"].minimise` takes it
and gives an `Optimum`. To add a library: write a file here and add its name below; or put it into another package
behind an entry point `signid.optimisers`.
"""

from __future__ import annotations

from ..registry import Registry
from .base import Optimiser, Optimum, Problem

__all__ = ["OPTIMISERS", "Optimiser", "Optimum", "Problem"]
OPTIMISERS: Registry[Optimiser] = Registry("optimisers", __name__, "nlopt_ scipy_")
