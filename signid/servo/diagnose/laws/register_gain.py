"""Gain of the firmware that does not follow its register: the stated gain is wrong by a power of two."""

import numpy as np

from ....servos import Servo
from .base import DriveLaw, Twin, scaled

NEAR = 0.04  # [1] of a power of two in which a ratio counts as one


def _plausible(before: Servo, after: Servo) -> float:
    """Registers are scaled by powers of two: other ratios are errors of the gain itself."""
    octaves = np.log2(max(after.kp, 1e-9) / before.kp)
    power = round(float(octaves))
    return 2.0 if power and abs(2.0 ** (octaves - power) - 1) < NEAR else 1e-4


LAW = DriveLaw(
    effect="register_gain",
    numbers=("kp",),
    meaning="the firmware runs with another gain register than stated",
    variable="torque",
    trials=scaled("kp", 0.25, 0.5, 2.0, 4.0),
    tolerance=0.2,
    twins=(Twin("servo_gain", "record the same motion with two values of the gain register of the firmware"),),
    plausible=_plausible,
    key="kp",
)
