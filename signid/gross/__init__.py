"""Gross faults of recordings, found before anything is fitted: order, signs, units, lags, clipping, too little."""

from .examine import examine
from .result import Finding, Gross

__all__ = ["Finding", "Gross", "examine"]
