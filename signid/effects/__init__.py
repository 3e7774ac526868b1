"""Physical laws: friction, springs, bodies, drives, and errors of recorded torque and position. One law per file.

Identification, simulation, diagnosis and reports use the same elementwise implementation of a law. `EFFECTS["spring"]`
is one law; iterating over `EFFECTS` yields all laws of torque, over `DRIVE_EFFECTS` those of position drives. The
`equation` of a law is executable text: its contribution to the recorded torque in terms of its parameters and t, q, v,
a, load, torque and inertia. At prismatic joints, N replaces N.m, and m replaces rad.

To add a law, write a module here after the example of `signid.effects.spring`, derive one of the five kinds of
`signid.effects.base` or `DriveLaw` of `signid.effects.drive`, and add its name below; or register an entry point
`signid.effects` in another package.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..registry import Registry

if TYPE_CHECKING:
    from .base import Effect
    from .drive import DriveLaw

EFFECT_NAMES = ("viscous_friction", "coulomb_friction", "torque_offset", "armature")  # identified by default
DRIVE_EFFECTS: Registry[DriveLaw] = Registry(
    "effects",
    __name__,
    """
    servo_gain register_gain servo_damping error_damping command_delay effort_limit duty_limit speed_limit dead_band
    profile_limit voltage_droop
    """,
)
EFFECTS: Registry[Effect] = Registry(
    "effects",
    __name__,
    """
    viscous_friction coulomb_friction torque_offset armature asymmetric_friction stribeck_friction quadratic_friction
    load_friction presliding_friction position_friction friction_drift spring cable_torque counterbalance torque_gain
    torque_ripple backlash joint_elasticity encoder_offset time_delay torque_lag payload link_inertia base_tilt gravity
    joint_coupling torque_saturation external_contact fluid_drag torque_sign channel_swap
    """,
    unlisted=f"empirical motor_friction {' '.join(DRIVE_EFFECTS.names)}",
)
