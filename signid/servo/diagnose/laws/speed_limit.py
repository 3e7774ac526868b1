"""Torque-speed line of a motor: less torque is left the faster it turns."""

from dataclasses import replace

import numpy as np

from ....servos import Servo
from .base import DriveLaw, Reach


def _trials(servo: Servo, reach: Reach) -> list[Servo]:
    stated = np.isfinite(servo.effort_limit)
    stalls = [servo.effort_limit] if stated else [x * reach.effort for x in (0.6, 0.9, 1.4)]
    tops = [x * reach.speed for x in (0.8, 1.2, 2.0, 4.0)]
    return [replace(servo, law="torque_speed", effort_limit=stall, speed_limit=top) for stall in stalls for top in tops]


LAW = DriveLaw(
    effect="speed_limit",
    numbers=("speed_limit", "effort_limit"),
    meaning="the torque left falls with speed, as a DC motor's does: none at `speed`",
    variable="velocity",
    trials=_trials,
    region="fast motion along the torque",
    key="speed",
)
