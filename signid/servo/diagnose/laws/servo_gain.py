"""Stiffness of the position loop."""

from .base import DriveLaw, Twin, scaled

REGISTERS = Twin("register_gain", "record the same motion with two values of the gain register of the firmware", 0.5)

LAW = DriveLaw(
    effect="servo_gain",
    numbers=("kp",),
    meaning="the stiffness of the position loop is not the stated one",
    variable="torque",
    trials=scaled("kp", 0.5, 0.75, 0.9, 1.1, 1.35, 2.0),
    tolerance=0.03,
    twins=(REGISTERS,),
)
