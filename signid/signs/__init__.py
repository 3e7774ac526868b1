"""Torque whose sign was lost: segments, a search over their signs, and how sure each is."""

from .recover import Recovered, recover
from .result import Gain, Proof, Signs, Told, Trace

__all__ = ["Gain", "Proof", "Recovered", "Signs", "Told", "Trace", "recover"]
