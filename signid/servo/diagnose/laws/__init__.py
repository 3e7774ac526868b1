"""Laws that a diagnosis of position drives tries, one file each; `HYPOTHESES` holds all of them."""

from . import (
    command_delay,
    dead_band,
    droop,
    duty_limit,
    effort_limit,
    load_friction,
    profile_limit,
    register_gain,
    servo_damping,
    servo_gain,
    speed_limit,
)
from .base import DriveLaw, Reach, Twin
from .joint_laws import ARMATURE, COULOMB, OFFSET, VISCOUS

__all__ = ["HYPOTHESES", "DriveLaw", "Reach", "Twin"]

HYPOTHESES: tuple[DriveLaw, ...] = (
    servo_gain.LAW,
    register_gain.LAW,
    servo_damping.LAW,
    command_delay.LAW,
    effort_limit.LAW,
    duty_limit.LAW,
    speed_limit.LAW,
    dead_band.LAW,
    profile_limit.LAW,
    load_friction.LAW,
    droop.LAW,
    VISCOUS,
    COULOMB,
    ARMATURE,
    OFFSET,
)
