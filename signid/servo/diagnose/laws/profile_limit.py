"""Largest speed at which the firmware moves its own command."""

import numpy as np

from ....servos import Servo
from .base import DriveLaw, Reach


def _trials(servo: Servo, reach: Reach) -> list[Servo]:
    values = [x * reach.speed for x in (2.0, 1.3, 0.9, 0.6, 0.35)]
    if np.isfinite(servo.profile_speed):
        values += [x * servo.profile_speed for x in (0.7, 1.5)]
    return [servo.with_(profile_speed=x) for x in values]


LAW = DriveLaw(
    effect="profile_limit",
    numbers=("profile_speed",),
    meaning="the firmware moves its own command at most at this speed",
    variable="velocity",
    trials=_trials,
    region="commands faster than the profile",
    key="speed",
)
