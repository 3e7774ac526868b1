"""Physical laws: friction, springs, bodies, and errors of recorded torque and position. One law per file.

Identification, simulation, diagnosis and reports use the same elementwise implementation of a law. `EFFECTS["spring"]`
is one law; iterating over `EFFECTS` yields all. The `equation` of a law is executable text: its contribution to the
recorded torque in terms of its parameters and t, q, v, a, load, torque and inertia. At prismatic joints, N replaces
N.m, and m replaces rad.

To add a law, write a module here after the example of `signid.effects.spring`, derive one of the five kinds of
`signid.effects.base`, and add its name below; or register an entry point `signid.effects` in another package.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..registry import Registry

if TYPE_CHECKING:
    from .base import Effect

EFFECT_NAMES = ("viscous_friction", "coulomb_friction", "torque_offset", "armature")  # identified by default
EFFECTS: Registry[Effect] = Registry(
    "effects",
    __name__,
    """
    viscous_friction coulomb_friction torque_offset armature asymmetric_friction stribeck_friction quadratic_friction
    load_friction presliding_friction position_friction friction_drift spring cable_torque counterbalance torque_gain
    torque_ripple backlash joint_elasticity encoder_offset time_delay torque_lag payload link_inertia base_tilt gravity
    joint_coupling torque_saturation external_contact fluid_drag torque_sign channel_swap
    """,
    unlisted="empirical motor_friction",
)
