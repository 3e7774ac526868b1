"""Physical laws: friction, springs, bodies, drives, and errors of recorded torque and position. One law per file.

Identification, simulation, diagnosis and reports use the same elementwise implementation of a law. `EFFECTS["spring"]`
is one law; iterating over `EFFECTS` yields all laws of torque, over `DRIVE_EFFECTS` those of position drives. The
`equation` of a law is executable text: its contribution to the recorded torque in terms of its parameters and t, q, v,
a, load, torque and inertia. At prismatic joints, N replaces N.m, and m replaces rad.

To add a law, write a module here after the example of `signid.effects.spring`, and derive one of the five kinds of
`signid.effects.base` or `DriveLaw` of `signid.effects.drive`; `signid.types.Effect` has all that a law may state. It
stands behind the laws below, and a diagnosis takes it for rare unless it states `common`. Or register an entry point
`signid.effects` in another package.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..registry import Registry

if TYPE_CHECKING:
    from .base import Effect
    from .drive import DriveLaw

_SOURCES = {path.stem: path.read_text("utf-8") for path in sorted(Path(__file__).parent.glob("*.py"))}
_LAWS = [name for name, source in _SOURCES.items() if "\nPLUGIN = " in source]
_DRIVE_LAWS = [name for name in _LAWS if "(DriveLaw)" in _SOURCES[name]]
EFFECT_NAMES = ("viscous_friction", "coulomb_friction", "torque_offset", "armature")  # identified by default
LISTED_DRIVES = """
    servo_gain register_gain servo_damping error_damping command_delay effort_limit duty_limit speed_limit dead_band
    profile_limit voltage_droop link_encoder
""".split()
LISTED_LAWS = """
    viscous_friction coulomb_friction torque_offset armature asymmetric_friction stribeck_friction quadratic_friction
    load_friction presliding_friction position_friction friction_drift spring cable_torque counterbalance torque_gain
    torque_ripple backlash joint_elasticity encoder_offset time_delay torque_lag payload link_inertia base_tilt gravity
    joint_coupling torque_saturation external_contact fluid_drag torque_sign channel_swap
""".split()
DRIVE_EFFECTS: Registry[DriveLaw] = Registry("effects", __name__, " ".join(dict.fromkeys(LISTED_DRIVES + _DRIVE_LAWS)))
UNLISTED = f"empirical motor_friction gear_friction {' '.join(DRIVE_EFFECTS.names)}"
_TORQUE_LAWS = [name for name in dict.fromkeys(LISTED_LAWS + _LAWS) if name not in UNLISTED.split()]
EFFECTS: Registry[Effect] = Registry("effects", __name__, " ".join(_TORQUE_LAWS), unlisted=UNLISTED)
