"""Voltage droop: supply voltage that falls with the torque of the motor."""

from collections.abc import Sequence

import numpy as np

from ..servos import Servo
from ..types import Array, Shape
from .drive import DriveLaw, DriveState, Reach


class VoltageDroop(DriveLaw):
    """Torque per error that falls with torque, as with a weak supply."""

    name, equation = "voltage_droop", "torque / (1 + coefficient * abs(torque))"
    source = "Fitzgerald, Kingsley, Umans, Electric Machinery, McGraw-Hill, 2003, chapter 7 (DC machines)"
    headline = "voltage droop of the drive of {joint}: {coefficient}"
    typical = "a tenth to a half over the largest torque"
    parameters = {"coefficient": Shape("1/N.m", ())}
    example = {"coefficient": 0.02}
    stage, numbers = "supply", {"coefficient": "droop"}
    fault, variable = "the torque per error falls with torque, as with a weak supply", "torque"
    region = "large torque"
    tolerance, relative = 1e-3, False

    def acts(self, x: DriveState, coefficient: float) -> Array:
        return x.torque / (1 + coefficient * np.abs(x.torque))

    def trials(self, servo: Servo, reach: Reach) -> Sequence[Servo]:
        return [servo.with_(droop=servo.droop + x / max(reach.effort, 1e-9)) for x in (0.0, 0.2, 0.6, 2.0)]


PLUGIN = VoltageDroop()
