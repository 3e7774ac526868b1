"""Physical laws: friction, springs, bodies, and what recordings do to torque and position. One law, one file.

A law is written once, elementwise, and serves to identify, to simulate, to diagnose and to report. `EFFECTS["spring"]`
is one of them; iterating over `EFFECTS` gives all. What it adds to a robot's torque is its `equation`, which is text
that can be run, in its numbers and t, q, v, a, load, torque and inertia. At prismatic joints read N for N.m, m for rad.

To add a law: write a file here, as `signid.effects.spring` does, of one of the five kinds in `signid.effects.base`, and
add its name below; or put it into another package behind an entry point `signid.effects`.
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
    torque_ripple backlash joint_elasticity encoder_offset time_delay torque_lag payload link_inertia base_tilt
    joint_coupling torque_saturation external_contact fluid_drag torque_sign channel_swap
    """,
    unlisted="empirical",
)
