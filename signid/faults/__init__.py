"""Recording faults, found before a fit: wrong order, signs or units, lags, clipping, distortions, too little data.

`signid check`, `identify` and `diagnose` look for them: drop-outs, spikes and stuck sensors, exchanged or negated
columns, degrees instead of radians, wrong zeros, factors and clocks, torque that is late or clipped, another gravity.
Each `RecordingFault` has a sentence: the fault, its evidence, and how to correct it. Recordings of commands without
torque are audited joint by joint, without a description, by the package `commands`.
"""

from .channels import SAMPLE_KINDS, naming_faults
from .evidence import FaultEvidence
from .examine import described_evidence, examine, is_sole, under_found_gravity
from .identified import NO_EXCITATION, OF_A_FIT, IdentifiedData, identification_flags, recording_flags
from .result import REFUSE, JointAudit, RecordingFault, RecordingFaults, ServoAudit, UnusableRecordings

__all__ = [
    "NO_EXCITATION",
    "OF_A_FIT",
    "REFUSE",
    "SAMPLE_KINDS",
    "FaultEvidence",
    "IdentifiedData",
    "JointAudit",
    "RecordingFault",
    "RecordingFaults",
    "ServoAudit",
    "UnusableRecordings",
    "described_evidence",
    "examine",
    "identification_flags",
    "is_sole",
    "naming_faults",
    "recording_flags",
    "under_found_gravity",
]
