"""Torque whose sign was lost: segments, a search over their signs, and how sure each is.

A segment is a stretch in which a joint moves and its torque keeps one sign. The signs of all segments are searched
together, as friction brakes, inertia is positive, and joints feel each other; the search proves that no other choice
fits better, or tells by how much one could. Flags say when the model or the motion is too poor to believe it.
"""

from .recover import Recovered, recover
from .result import Gain, Proof, Signs, Told, Trace

__all__ = ["Gain", "Proof", "Recovered", "Signs", "Told", "Trace", "recover"]
