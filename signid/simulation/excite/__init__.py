"""Exciting motions, which make the dynamics of a robot identifiable.

`excite` searches for the motion with most information on the base parameters, within the limits and without
self-collision. `separate` searches for the motion along which two laws differ most, or finds that there is none. Both
begin and end at rest. `random_motion` does not search. `build_limits` gives the limits of the description.
"""

from .design import excite
from .families import random_motion
from .limits import Limits, build_limits
from .problem import Excitation, Separation, Use
from .separation import separate

__all__ = ["Excitation", "Limits", "Separation", "Use", "build_limits", "excite", "random_motion", "separate"]
