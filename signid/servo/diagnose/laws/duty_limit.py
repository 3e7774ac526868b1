"""Largest duty cycle of a DC motor: the torque of the error is limited, the back-EMF is not."""

from ....servos import Servo
from .base import DriveLaw, Reach
from .effort_limit import limits


def _trials(servo: Servo, reach: Reach) -> list[Servo]:
    return limits(servo, reach, "duty")


LAW = DriveLaw(
    effect="duty_limit",
    numbers=("effort_limit",),
    meaning="the duty cycle of the drive saturates; its damping by back-EMF stays",
    variable="torque",
    trials=_trials,
    region="errors that ask for more torque than the limit",
    key="limit",
)
