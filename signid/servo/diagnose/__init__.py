"""Diagnose position drives: name what a simulation of loop and robot lacks, from commands and positions alone."""

from .result import Number, PositionFit, ServoAlternative, ServoDiagnosis, ServoFinding, ServoUnexplained
from .run import diagnose_servos

__all__ = [
    "Number",
    "PositionFit",
    "ServoAlternative",
    "ServoDiagnosis",
    "ServoFinding",
    "ServoUnexplained",
    "diagnose_servos",
]
