"""Recording -> usable stretches on a uniform grid: what its clock does, where it breaks, and its samples there.

Uneven time steps are resampled; gaps and missing values part a recording into stretches.
"""

from .grid import samples
from .stretch import Sampling, excerpt, split, spread
from .survey import survey

__all__ = ["Sampling", "excerpt", "samples", "split", "spread", "survey"]
