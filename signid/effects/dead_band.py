"""Dead band: position errors below which a drive gives no torque."""

from collections.abc import Sequence

import numpy as np

from ..servos import Servo
from ..types import Array, Shape
from .drive import DriveLaw, DriveState, Reach


class DeadBand(DriveLaw):
    """Part of the position error that the firmware ignores."""

    name, equation = "dead_band", "error - clip(error, -band, band)"
    source = "Slotine, Li, Applied Nonlinear Control, Prentice Hall, 1991, section 5.2 (dead zones)"
    headline = "dead band of the drive of {joint}: {band}"
    typical = "one to five counts of the encoder: 1 to 10 mrad"
    parameters = {"band": Shape("rad", ())}
    example = {"band": 0.01}
    stage, numbers = "error", {"band": "dead_band"}
    fault, variable, region = "position errors below the band give no torque", "position", "small errors"
    tolerance, relative = 1e-3, False

    def acts(self, x: DriveState, band: float) -> Array:
        return x.error - np.clip(x.error, -band, band)

    def trials(self, servo: Servo, reach: Reach) -> Sequence[Servo]:
        return [servo.with_(dead_band=servo.dead_band + x * reach.error) for x in (0.01, 0.03, 0.08, 0.2)]


PLUGIN = DeadBand()
