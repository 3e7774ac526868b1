"""Motions that excite: what a robot should do, so that its dynamics can be told."""

from .draw import random_motion
from .limits import Limits, build_limits
from .plan import excite
from .result import Excitation, Separation, Use
from .separate import separate

__all__ = ["Excitation", "Limits", "Separation", "Use", "build_limits", "excite", "random_motion", "separate"]
