"""Largest torque of a drive whose damping is inside the limit."""

from dataclasses import replace

import numpy as np

from ....servos import Servo
from .base import DriveLaw, Reach


def limits(servo: Servo, reach: Reach, law: str) -> list[Servo]:
    """Servos with limits below the largest torque, and around a stated one."""
    values = [x * reach.effort for x in (0.9, 0.75, 0.6, 0.45, 0.3)]
    if np.isfinite(servo.effort_limit):
        values += [x * servo.effort_limit for x in (0.8, 1.25, 1.6, 2.5)]
    return [replace(servo, law=law, effort_limit=x) for x in values]


def _trials(servo: Servo, reach: Reach) -> list[Servo]:
    return limits(servo, reach, "torque_speed" if servo.law == "torque_speed" else "effort")


LAW = DriveLaw(
    effect="effort_limit",
    numbers=("effort_limit",),
    meaning="the drive gives at most this torque, damping included",
    variable="torque",
    trials=_trials,
    region="errors that ask for more torque than the limit",
    key="limit",
)
