"""Signs and zeros of recorded positions against the description, found by the load of the loops."""

from .result import JointZero
from .run import find_zeros, turns

__all__ = ["JointZero", "find_zeros", "turns"]
