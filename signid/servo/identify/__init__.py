"""Identify position drives from commanded and measured positions: law, numbers, intervals, what is identifiable."""

from ..search.searcher import ServoOptions
from .result import ServoIdentification, ServoJoint, ServoNumber, ServoRollOut, ServoScale, ServoTrace
from .run import identify_servos

__all__ = [
    "ServoIdentification",
    "ServoJoint",
    "ServoNumber",
    "ServoOptions",
    "ServoRollOut",
    "ServoScale",
    "ServoTrace",
    "identify_servos",
]
