"""Fit the numbers of drives to recordings on grids: a start by regression, then output error of the closed loop."""

from .fit import ServoFit, fit_servos
from .start import start_limits, start_servos

__all__ = ["ServoFit", "fit_servos", "start_limits", "start_servos"]
