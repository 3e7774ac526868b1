"""Register gain: the firmware runs with another gain register than stated."""

from collections.abc import Sequence

import numpy as np

from ..servos import Servo
from .drive import Reach, Twin, scaled
from .servo_gain import ServoGain

RATIO_TOLERANCE = 0.04  # [1] of a power of two in which a ratio counts as one


class RegisterGain(ServoGain):
    """Gain of the firmware that does not follow its register: the stated gain is wrong by a power of two."""

    name = "register_gain"
    source = "ROBOTIS, e-Manual of the XL330-M288, control table (position gains are registers over powers of two)"
    headline = "gain register of the drive of {joint}: {kp}"
    typical = "a quarter, half, twice or four times the stated gain"
    fault = "the firmware runs with another gain register than stated"
    tolerance = 0.2
    rivals = (Twin("servo_gain", "record the same motion with two values of the gain register of the firmware"),)

    def stated(self, servo: Servo) -> dict[str, float] | None:
        return None  # it is a fault of `servo_gain`

    def trials(self, servo: Servo, reach: Reach) -> Sequence[Servo]:
        return scaled(servo, "kp", 0.25, 0.5, 2.0, 4.0)

    def plausible(self, before: Servo, after: Servo) -> float:
        """Registers are scaled by powers of two: other ratios are errors of the gain itself."""
        octaves = np.log2(max(after.kp, 1e-9) / before.kp)
        power = round(float(octaves))
        return 2.0 if power and abs(2.0 ** (octaves - power) - 1) < RATIO_TOLERANCE else 1e-4


PLUGIN = RegisterGain()
