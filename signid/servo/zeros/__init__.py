"""Signs and zeros of recorded positions against the description, found by the load of the loops."""

from .run import JointZero, find_zeros, turns

__all__ = ["JointZero", "find_zeros", "turns"]
