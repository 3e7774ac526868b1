"""Minimisers, one library per file.

A `Problem` is an objective with bounds, a start and an optional gradient. `OPTIMISERS["nlopt"].minimise` solves it and
returns an `Optimum`. To add a library, write a module here and add its name below, or register an entry point
`signid.optimisers` in another package.
"""

from __future__ import annotations

from ..registry import Registry
from .base import Optimiser, Optimum, Problem

__all__ = ["OPTIMISERS", "Optimiser", "Optimum", "Problem"]
OPTIMISERS: Registry[Optimiser] = Registry("optimisers", __name__, "nlopt_")
