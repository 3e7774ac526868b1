"""Recording faults, found before a fit: wrong order, signs or units, lags, clipping, too little data.

`signid check` and `signid diagnose` look for them first: exchanged or negated columns, degrees instead of radians,
torque that is late or clipped. Each `Finding` has a sentence: the fault, its evidence, and how to correct it.
"""

from .examine import examine
from .identified import IdentifiedData, identification_flags
from .result import REFUSE, RecordingFault, RecordingFaults

__all__ = ["REFUSE", "RecordingFault", "RecordingFaults", "IdentifiedData", "examine", "identification_flags"]
