"""Time from the command's stamp to its effect."""

from ....servos import Servo
from .base import DriveLaw, Reach


def _trials(servo: Servo, _: Reach) -> list[Servo]:
    return [servo.with_(delay=max(servo.delay + x, 0.0)) for x in (0.0, -0.015, 0.01, 0.03)]


LAW = DriveLaw(
    effect="command_delay",
    numbers=("delay",),
    meaning="the command acts earlier or later than stated",
    variable="velocity",
    trials=_trials,
    tolerance=1e-3,
    relative=False,
    key="delay",
)
