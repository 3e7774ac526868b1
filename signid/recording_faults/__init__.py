"""Recording faults, found before a fit: wrong order, signs or units, lags, clipping, distortions, too little data.

`signid check`, `identify` and `diagnose` look for them: drop-outs, spikes and stuck sensors, exchanged or negated
columns, degrees instead of radians, wrong zeros, factors and clocks, torque that is late or clipped, another gravity.
Each `RecordingFault` has a sentence: the fault, its evidence, and how to correct it.
"""

from .evidence import FaultEvidence
from .examine import described_evidence, examine, is_sole, under_found_gravity
from .identified import IdentifiedData, identification_flags
from .recorded import NO_EXCITATION, OF_A_FIT, recording_flags
from .result import REFUSE, RecordingFault, RecordingFaults
from .samples import SAMPLE_KINDS, naming_faults

__all__ = [
    "NO_EXCITATION",
    "OF_A_FIT",
    "REFUSE",
    "SAMPLE_KINDS",
    "FaultEvidence",
    "RecordingFault",
    "RecordingFaults",
    "IdentifiedData",
    "described_evidence",
    "examine",
    "is_sole",
    "identification_flags",
    "naming_faults",
    "recording_flags",
    "under_found_gravity",
]
