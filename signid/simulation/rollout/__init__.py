"""Validation by simulation: a model over short windows of a recording.

From the measured state, under the recorded torque, for some tenths of a second: how far does the simulated robot stray
from the recorded one? Longer would tell little, as any error of the state grows.
"""

from .result import RollOut
from .run import roll_out

__all__ = ["RollOut", "roll_out"]
