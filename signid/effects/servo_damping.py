"""Servo damping: torque of a drive against the speed of its joint."""

from collections.abc import Sequence

from ..servos import Servo
from ..types import Array, Coefficient
from .drive import DriveLaw, DriveState, Reach, Twin

DRIVE_OFF_ADVICE = "let the joint swing with the drive off: viscous friction stays, the damping of the drive does not"


class ServoDamping(DriveLaw):
    """Damping of a drive while it is on, back-EMF included."""

    name, equation = "servo_damping", "torque - kd * v"
    source = (
        "Astrom, Murray, Feedback Systems, Princeton University Press, 2008, section 10.1 (derivative of the output)"
    )
    headline = "damping of the drive of {joint}: {kd}"
    typical = "0.02 to 0.2 times the gain per second"
    parameters = {"kd": Coefficient("N.m.s/rad", positive=True)}
    example = {"kd": 1.5}
    stage, numbers = "damping", {"kd": "kd"}
    fault, variable = "the damping of the drive is not the stated one", "velocity"
    tolerance = 0.05
    rivals = (Twin("viscous_friction", DRIVE_OFF_ADVICE),)

    def acts(self, x: DriveState, kd: float) -> Array:
        return x.torque - kd * x.v

    def stated(self, servo: Servo) -> dict[str, float] | None:
        return super().stated(servo) if servo.kd_on == "velocity" else None

    def trials(self, servo: Servo, reach: Reach) -> Sequence[Servo]:
        size = max(servo.damping, 0.1 * reach.effort / max(reach.speed, 1e-6))
        return [servo.with_(kd=max(servo.kd + x * size, 0.0)) for x in (0.0, -0.5, 0.6, 1.5)]


PLUGIN = ServoDamping()
