"""Recording -> usable stretches on a uniform grid: what its clock does, where it breaks, and its samples there."""

from .grid import samples
from .stretch import Sampling, excerpt, split
from .survey import survey

__all__ = ["Sampling", "excerpt", "samples", "split", "survey"]
