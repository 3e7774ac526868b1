"""Motions that excite: what a robot should do, so that its dynamics can be told.

`excite` seeks the motion that tells the base parameters best within the limits and clear of the robot's own links;
`separate` the one along which two laws differ most, or the finding that none does; `random_motion` seeks nothing. All
begin and end at rest. `build_limits` gives the limits of the description, to be changed as wanted.
"""

from .design import excite
from .discriminate.run import separate
from .limits import Limits, build_limits
from .motions.random_motion import random_motion
from .result import Excitation, Separation, Use

__all__ = ["Excitation", "Limits", "Separation", "Use", "build_limits", "excite", "random_motion", "separate"]
