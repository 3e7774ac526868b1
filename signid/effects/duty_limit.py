"""Duty limit: largest duty cycle of a DC motor."""

from collections.abc import Sequence

import numpy as np

from ..servos import Servo
from ..types import Array, Shape
from .drive import DriveLaw, DriveState, Reach, limits


class DutyLimit(DriveLaw):
    """The torque of the position error is limited, the damping by back-EMF is not."""

    name, equation = "duty_limit", "clip(torque, -limit, limit)"
    source = "Duclusaud, Passault, Padois, Ly, Extended friction models for servo actuators, arXiv 2410.08650"
    headline = "the duty cycle of the drive of {joint} ends at {limit}"
    typical = "the stall torque of the motor"
    parameters = {"limit": Shape("N.m", ())}
    example = {"limit": 20.0}
    optional = ("limit",)  # none: no limit
    stage, numbers, form = "duty", {"limit": "effort_limit"}, "duty"
    fault, variable = "the duty cycle of the drive saturates; its damping by back-EMF stays", "torque"
    region = "errors that ask for more torque than the limit"

    def acts(self, x: DriveState, limit: float = np.inf) -> Array:
        return np.clip(x.torque, -limit, limit)

    def trials(self, servo: Servo, reach: Reach) -> Sequence[Servo]:
        return limits(servo, reach, "duty")


PLUGIN = DutyLimit()
