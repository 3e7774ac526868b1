"""Identify position drives from commanded and measured positions: law, numbers, intervals, what is identifiable."""

from .result import ServoIdentification, ServoJoint, ServoNumber, ServoRollOut, ServoScale, ServoTrace
from .run import identify_servos
from .search import ServoOptions

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
