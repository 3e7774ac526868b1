"""Effort limit: largest torque of a drive, damping included."""

from collections.abc import Sequence

import numpy as np

from ..servos import Servo
from ..types import Array, Shape
from .drive import DriveLaw, DriveState, Reach, limits


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


PLUGIN = EffortLimit()
