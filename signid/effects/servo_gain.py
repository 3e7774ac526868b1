"""Servo gain: stiffness of the position loop of a drive."""

from collections.abc import Sequence

from ..servos import Servo
from ..types import Array, Coefficient, Shape
from .drive import DriveLaw, DriveState, Reach, scaled


class ServoGain(DriveLaw):
    """Torque of a drive proportional to its position error."""

    name, equation = "servo_gain", "torque + kp * error"
    source = "Astrom, Murray, Feedback Systems, Princeton University Press, 2008, section 10.1 (proportional control)"
    headline = "gain of the drive of {joint}: {kp}"
    typical = "1 to 20 N.m/rad (hobby servos), 20 to 100 N.m/rad (legs), more in industrial drives"
    parameters = {"kp": Coefficient("N.m/rad", positive=True), "register": Shape("1", ())}
    example = {"kp": 50.0, "register": 400.0}
    optional = ("register",)  # of the firmware, that kp belongs to
    stage, numbers = "gain", {"kp": "kp", "register": "kp_register"}
    fault, variable = "the stiffness of the position loop is not the stated one", "torque"

    def acts(self, x: DriveState, kp: float, register: float = 0.0) -> Array:
        return x.torque + kp * x.error

    def stated(self, servo: Servo) -> dict[str, float] | None:
        return {"kp": servo.kp, **(super().stated(servo) or {})}

    def trials(self, servo: Servo, reach: Reach) -> Sequence[Servo]:
        return scaled(servo, "kp", 0.5, 0.75, 1.35, 2.0)


PLUGIN = ServoGain()
