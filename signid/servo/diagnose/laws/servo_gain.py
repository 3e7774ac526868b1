"""Stiffness of the position loop."""

from .base import DriveLaw, scaled

LAW = DriveLaw(
    effect="servo_gain",
    numbers=("kp",),
    meaning="the stiffness of the position loop is not the stated one",
    variable="torque",
    trials=scaled("kp", 0.5, 0.75, 1.35, 2.0),
    tolerance=0.03,
)
