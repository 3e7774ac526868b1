"""Errors below which the firmware gives no torque."""

from ....servos import Servo
from .base import DriveLaw, Reach, Twin

LOADS = "repeat with another load: a dead band is left on the side of the load, play changes with the sign of the load"


def _trials(servo: Servo, reach: Reach) -> list[Servo]:
    return [servo.with_(dead_band=servo.dead_band + x * reach.error) for x in (0.01, 0.03, 0.08, 0.2)]


LAW = DriveLaw(
    effect="dead_band",
    numbers=("dead_band",),
    meaning="position errors below the band give no torque",
    variable="position",
    trials=_trials,
    tolerance=1e-3,
    relative=False,
    twins=(Twin("backlash", LOADS, 0.8),),
    region="small errors",
    key="band",
)
