"""Damping of the drive while it is on."""

from ....servos import Servo
from .base import DriveLaw, Reach, Twin

OFF = "let the joint swing with the drive off: viscous friction stays, the damping of the drive does not"


def _trials(servo: Servo, reach: Reach) -> list[Servo]:
    size = max(servo.damping, 0.1 * reach.effort / max(reach.speed, 1e-6))
    return [servo.with_(kd=max(servo.kd + x * size, 0.0)) for x in (0.0, -0.5, 0.6, 1.5)]


LAW = DriveLaw(
    effect="servo_damping",
    numbers=("kd",),
    meaning="the damping of the drive is not the stated one",
    variable="velocity",
    trials=_trials,
    tolerance=0.05,
    twins=(Twin("viscous_friction", OFF),),
)
