"""Recording faults of recordings, found before anything is fitted: order, signs, units, lags, clipping, too little.

`signid check` and `signid diagnose` look for them first: columns exchanged or negated, degrees for radians, torque that
comes late or reaches a limit. Each `Finding` is a sentence: what is wrong, how sure that is, and how to mend it.
"""

from .examine import examine
from .identified import IdentifiedData, identification_flags
from .result import REFUSE, Finding, RecordingFaults

__all__ = ["REFUSE", "Finding", "RecordingFaults", "IdentifiedData", "examine", "identification_flags"]
