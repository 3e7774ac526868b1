"""Gain of the firmware that does not follow its register: the stated gain is wrong by a power of two."""

from .base import DriveLaw, Twin, scaled

LAW = DriveLaw(
    effect="register_gain",
    numbers=("kp",),
    meaning="the firmware runs with another gain register than stated",
    variable="torque",
    trials=scaled("kp", 0.25, 0.5, 2.0, 4.0),
    tolerance=0.2,
    twins=(Twin("servo_gain", "record the same motion with two values of the gain register of the firmware"),),
    prior=0.5,
    key="kp",
)
