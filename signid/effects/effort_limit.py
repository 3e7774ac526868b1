"""Effort limit: largest torque of a drive, damping included."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..servos import Servo
from ..types import Array, Shape
from .drive import DriveLaw, DriveState, Reach


class EffortLimit(DriveLaw):
    """The drive gives at most this torque; its damping is inside the limit."""

    name, equation = "effort_limit", "clip(torque, -limit, limit)"
    source = "Isaac Lab, actuators.IdealPDActuator (effort_limit clips the sum of both gains)"
    headline = "the drive of {joint} gives at most {limit}"
    typical = "the effort limit of the description, or less"
    parameters = {"limit": Shape("N.m", ())}
    example = {"limit": 20.0}
    stage, numbers, form = "limit", {"limit": "effort_limit"}, "effort"
    fault, variable = "the drive gives at most this torque, damping included", "torque"
    region = "errors that ask for more torque than the limit"

    def acts(self, x: DriveState, limit: float) -> Array:
        return np.clip(x.torque, -limit, limit)

    def trials(self, servo: Servo, reach: Reach) -> Sequence[Servo]:
        return limits(servo, reach, "torque_speed" if servo.law == "torque_speed" else "effort")


def limits(servo: Servo, reach: Reach, form: str) -> list[Servo]:
    """Drives with limits below the largest torque, and around a stated one."""
    values = [x * reach.effort for x in (0.9, 0.75, 0.6, 0.45, 0.3)]
    if np.isfinite(servo.effort_limit):
        values += [x * servo.effort_limit for x in (0.8, 1.25, 1.6, 2.5)]
    return [replace(servo, law=form, effort_limit=x) for x in values]


PLUGIN = EffortLimit()
