"""Profile limit: largest speed at which the firmware moves its own command."""

from collections.abc import Sequence

import numpy as np

from ..servos import Servo
from ..types import Array, Shape
from .drive import DriveLaw, Reach


class ProfileLimit(DriveLaw):
    """The drive follows a command of its own, which approaches the given one at most at this speed."""

    name, equation = "profile_limit", "command_slewed(speed)"
    source = "ROBOTIS, e-Manual of the XL330-M288, control table (Profile Velocity)"
    headline = "the drive of {joint} moves its command at most at {speed}"
    typical = "0.5 to 5 rad/s"
    parameters = {"speed": Shape("rad/s", ())}
    example = {"speed": 2.0}
    stage, numbers = "profile", {"speed": "profile_speed"}
    fault, variable = "the firmware moves its own command at most at this speed", "velocity"
    region = "commands faster than the profile"

    def moved(self, t: Array, command: Array, speed: float) -> Array:
        out, now = np.array(command, float), float(command[0])
        for k, (wanted, dt) in enumerate(zip(command[1:].tolist(), np.diff(t).tolist(), strict=True), 1):
            now += min(max(wanted - now, -speed * dt), speed * dt)
            out[k] = now
        return out

    def trials(self, servo: Servo, reach: Reach) -> Sequence[Servo]:
        values = [x * reach.speed for x in (2.0, 1.3, 0.9, 0.6, 0.35)]
        if np.isfinite(servo.profile_speed):
            values += [x * servo.profile_speed for x in (0.7, 1.5)]
        return [servo.with_(profile_speed=x) for x in values]


PLUGIN = ProfileLimit()
