"""Identify position drives from commanded and measured positions: law, numbers, intervals, what is identifiable."""

from ..search.choice import ServoOptions
from .result import FrictionModel, ServoIdentification, ServoJoint, ServoNumber, ServoRollOut, ServoScale, ServoTrace
from .run import identify_servos

__all__ = [
    "FrictionModel",
    "ServoIdentification",
    "ServoJoint",
    "ServoNumber",
    "ServoOptions",
    "ServoRollOut",
    "ServoScale",
    "ServoTrace",
    "identify_servos",
]
