"""Sampling of recordings: usable stretches, their uniform time grid, and samples on it.

Nonuniform time steps are resampled; gaps and long holes of missing values split a recording into stretches.
"""

from .clock import time_origin
from .grid import Sampling, between, one_after_another, samples, select_stretches, split
from .survey import survey

__all__ = ["Sampling", "between", "one_after_another", "samples", "select_stretches", "split", "survey", "time_origin"]
