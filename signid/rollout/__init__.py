"""Validation by simulation: a model over short windows of a recording."""

from .result import RollOut as RollOut
from .run import roll_out as roll_out
