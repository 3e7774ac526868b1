"""Physical laws. To add one: write a file here, add its name below."""

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
    torque_ripple backlash joint_elasticity encoder_offset time_delay torque_lag payload link_inertia base_tilt
    joint_coupling torque_saturation external_contact fluid_drag torque_sign channel_swap
    """,
    unlisted="empirical",
)
