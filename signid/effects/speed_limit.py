"""Speed limit: torque-speed line of a motor."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..servos import Servo
from ..types import Array, Shape
from .drive import DriveLaw, DriveState, Reach


class SpeedLimit(DriveLaw):
    """The faster a motor turns, the less torque is left along its motion; none at `speed`."""

    name = "speed_limit"
    equation = "sign(torque) * minimum(abs(torque), effort_limit * (1 - (torque * v > 0) * minimum(abs(v) / speed, 1)))"
    source = "Isaac Lab, actuators.DCMotor (saturation_effort and velocity_limit)"
    headline = "the drive of {joint} has no torque left at {speed}"
    typical = "no-load speed 4 to 30 rad/s, effort_limit the stall torque"
    parameters = {"speed": Shape("rad/s", ()), "effort_limit": Shape("N.m", ())}
    example = {"speed": 8.0, "effort_limit": 20.0}
    optional = ("speed", "effort_limit")  # none: no limit
    stage, numbers, form = "limit", {"speed": "speed_limit", "effort_limit": "effort_limit"}, "torque_speed"
    fault, variable = "the torque left falls with speed, as a DC motor's does: none at `speed`", "velocity"
    region = "fast motion along the torque"

    def acts(self, x: DriveState, speed: float = np.inf, effort_limit: float = np.inf) -> Array:
        left = np.where(x.torque * x.v > 0, np.maximum(1 - np.abs(x.v) / speed, 0), 1)
        most = np.where(left > 0, effort_limit, 0) * np.where(left > 0, left, 1)
        return np.asarray(np.sign(x.torque) * np.minimum(np.abs(x.torque), most))

    def trials(self, servo: Servo, reach: Reach) -> Sequence[Servo]:
        known, drive = servo.effort_limit, replace(servo, law=self.form)
        stalls = [known] if np.isfinite(known) else [x * reach.effort for x in (0.6, 0.9, 1.4)]
        tops = [x * reach.speed for x in (0.8, 1.2, 2.0, 4.0)]
        return [drive.with_(effort_limit=stall, speed_limit=top) for stall in stalls for top in tops]


PLUGIN = SpeedLimit()
