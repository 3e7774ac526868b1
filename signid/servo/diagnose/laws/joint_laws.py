"""Laws of the joint behind the drive: friction, rotor inertia, offset."""

from ....servos import Servo
from .base import DriveLaw, Reach, Twin, scaled
from .servo_damping import OFF

GRAVITY = "repeat in a posture with another gravity torque: the offset stays, a shifted zero of the command does not"


def _viscous(servo: Servo, reach: Reach) -> list[Servo]:
    size = max(servo.damping, 0.1 * reach.effort / max(reach.speed, 1e-6))
    return [servo.with_(viscous_friction=max(servo.viscous_friction + x * size, 0.0)) for x in (0.0, -0.3, 0.6, 1.5)]


def _coulomb(servo: Servo, reach: Reach) -> list[Servo]:
    values = [servo.coulomb_friction + x * reach.effort for x in (0.0, 0.05, 0.15)]
    return [servo.with_(coulomb_friction=x) for x in values]


def _offset(servo: Servo, reach: Reach) -> list[Servo]:
    return [servo.with_(torque_offset=servo.torque_offset + x * reach.effort) for x in (-0.1, 0.0, 0.1)]


VISCOUS = DriveLaw(
    effect="viscous_friction",
    numbers=("viscous_friction",),
    meaning="the viscous friction of the joint is not the stated one",
    variable="velocity",
    trials=_viscous,
    tolerance=0.05,
    twins=(Twin("servo_damping", OFF),),
    key="coefficient",
)
COULOMB = DriveLaw(
    effect="coulomb_friction",
    numbers=("coulomb_friction",),
    meaning="the dry friction of the joint is not the stated one",
    variable="velocity",
    trials=_coulomb,
    tolerance=0.05,
    key="level",
)
ARMATURE = DriveLaw(
    effect="armature",
    numbers=("armature",),
    meaning="the inertia of the rotor is not the stated one",
    variable="acceleration",
    trials=scaled("armature", 0.4, 2.0, 5.0),
    tolerance=0.05,
    key="inertia",
)
OFFSET = DriveLaw(
    effect="torque_offset",
    numbers=("torque_offset",),
    meaning="a constant torque acts on the joint",
    variable="position",
    trials=_offset,
    tolerance=5e-3,
    relative=False,
    twins=(Twin("encoder_offset", GRAVITY, 0.3),),
    key="offset",
)
