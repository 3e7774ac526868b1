"""Supply voltage that falls with the torque of the motor."""

from ....servos import Servo
from .base import DriveLaw, Reach


def _trials(servo: Servo, reach: Reach) -> list[Servo]:
    return [servo.with_(droop=servo.droop + x / max(reach.effort, 1e-9)) for x in (0.0, 0.2, 0.6, 2.0)]


LAW = DriveLaw(
    effect="voltage_droop",
    numbers=("droop",),
    meaning="the torque per error falls with torque, as with a weak supply",
    variable="torque",
    trials=_trials,
    tolerance=1e-3,
    relative=False,
    key="coefficient",
    region="large torque",
)
