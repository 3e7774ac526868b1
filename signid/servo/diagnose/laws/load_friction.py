"""Dry friction in proportion to the torque of the motor, as in plastic gears."""

from ....servos import Servo
from .base import DriveLaw, Reach


def _trials(servo: Servo, _: Reach) -> list[Servo]:
    return [servo.with_(load_friction=servo.load_friction + x) for x in (0.0, 0.05, 0.2, 0.5)]


LAW = DriveLaw(
    effect="load_friction",
    numbers=("load_friction",),
    meaning="dry friction grows with the torque of the motor",
    variable="torque",
    trials=_trials,
    tolerance=0.02,
    relative=False,
    key="coefficient",
)
