"""Diagnose position drives: name what a simulation of loop and robot lacks, from commands and positions alone."""

from .conclude import (
    FoundNumber,
    PositionFit,
    ServoAlternative,
    ServoDiagnosis,
    ServoFinding,
    ServoRepeats,
    ServoUnexplained,
)
from .run import diagnose_servos

__all__ = [
    "FoundNumber",
    "PositionFit",
    "ServoAlternative",
    "ServoDiagnosis",
    "ServoFinding",
    "ServoRepeats",
    "ServoUnexplained",
    "diagnose_servos",
]
