"""Error damping: derivative gain of a drive on the error of its speed."""

from collections.abc import Mapping
from dataclasses import replace

from ..servos import Servo
from ..types import Array, Coefficient
from .drive import DriveLaw, DriveState


class ErrorDamping(DriveLaw):
    """Torque of a drive proportional to the speed of the command minus that of the joint."""

    name, equation = "error_damping", "torque + kd * (reference - v)"
    source = (
        "Astrom, Murray, Feedback Systems, Princeton University Press, 2008, section 10.1 (derivative of the error)"
    )
    headline = "derivative gain of the drive of {joint}: {kd}"
    typical = "0.02 to 0.2 times the gain per second"
    parameters = {"kd": Coefficient("N.m.s/rad", positive=True)}
    example = {"kd": 1.5}
    stage, numbers = "damping", {"kd": "kd"}

    def acts(self, x: DriveState, kd: float) -> Array:
        return x.torque + kd * (x.reference - x.v)

    def stated(self, servo: Servo) -> dict[str, float] | None:
        return {"kd": servo.kd} if servo.kd_on == "error" else None

    def packed(self, servo: Servo, parameters: Mapping[str, float]) -> Servo:
        return replace(super().packed(servo, parameters), kd_on="error")


PLUGIN = ErrorDamping()
