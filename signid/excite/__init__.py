"""Motions that excite: what a robot should do, so that its dynamics can be told.

`excite` seeks the motion that tells the base parameters best within the limits and clear of the robot's own links;
`separate` the one along which two laws differ most, or the finding that none does; `random_motion` seeks nothing. All
begin and end at rest. `build_limits` gives the limits of the description, to be changed as wanted.
"""

from .draw import random_motion
from .limits import Limits, build_limits
from .plan import excite
from .result import Excitation, Separation, Use
from .separate import separate

__all__ = ["Excitation", "Limits", "Separation", "Use", "build_limits", "excite", "random_motion", "separate"]
