"""Simulation and recordings -> where they differ, why, and the simulation that lacks nothing more."""

from .result import Alternative, Diagnosis, Finding, Unexplained
from .run import diagnose

__all__ = ["Alternative", "Diagnosis", "Finding", "Unexplained", "diagnose"]
