"""Validation by simulation of a model over short windows of a recording.

A window starts at the measured state and applies the recorded torque for some tenths of a second. Longer windows are
less informative, since any error of the state grows.
"""

from .run import RollOut, roll_out

__all__ = ["RollOut", "roll_out"]
