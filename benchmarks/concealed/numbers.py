"""Errors of the parameters of a correctly named law."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

EACH: Mapping[str, tuple[str, ...]] = {  # parameters whose relative errors are averaged
    "viscous_friction": ("coefficient",),
    "coulomb_friction": ("level",),
    "asymmetric_friction": ("viscous_positive", "viscous_negative", "coulomb_positive", "coulomb_negative"),
    "stribeck_friction": ("level", "velocity"),
    "quadratic_friction": ("coefficient",),
    "load_friction": ("coefficient",),
    "presliding_friction": ("level", "distance"),
    "position_friction": ("amplitude", "frequency"),
    "friction_drift": ("change",),
    "armature": ("inertia",),
    "torque_offset": ("offset",),
    "spring": ("stiffness",),
    "cable_torque": ("cubic",),
    "torque_gain": ("error",),
    "torque_ripple": ("amplitude", "frequency"),
    "backlash": ("gap",),
    "joint_elasticity": ("stiffness",),
    "encoder_offset": ("offset",),
    "time_delay": ("delay",),
    "torque_lag": ("time_constant",),
    "joint_coupling": ("viscous", "coulomb"),
    "torque_saturation": ("limit",),
    "fluid_drag": ("coefficient",),
}
TOGETHER: Mapping[
    str, Mapping[str, float]
] = {  # vectors: length of the difference over that of the truth, in these units
    "payload": {"mass": 0.1, "first_moment_x": 1.0, "first_moment_y": 1.0, "first_moment_z": 1.0},
    "base_tilt": {"x": 1.0, "y": 1.0},
    "external_contact": {"force_x": 1.0, "force_y": 1.0, "force_z": 1.0},
}
UNSIGNED = ("position_friction", "torque_ripple")  # a negative amplitude is a phase shift
ROUGH = (  # laws with less accurate parameters
    *("load_friction", "stribeck_friction", "position_friction", "external_contact", "friction_drift"),
    *("joint_elasticity", "backlash", "presliding_friction"),
)
SEEN = 3  # joints needed to identify all parameters of a body or a push


def error(effect: str, found: Mapping[str, Any], true: Mapping[str, Any], joints: int) -> float:
    """Relative error of a law's parameters; NaN if some are unidentifiable or missing.

    Args:
        effect: name of the effect.
        found: parameters of a finding, `{"value": ...}` by key.
        true: true parameters by key.
        joints: number of joints.
    """
    if effect == "counterbalance":
        pairs = [_wave(found), (float(true["amplitude"]), float(true["phase"]))]
        (one, other) = (np.array([a * math.cos(phase), a * math.sin(phase)]) for a, phase in pairs)
        return float(np.linalg.norm(one - other) / np.linalg.norm(other))
    if effect in TOGETHER and joints >= SEEN:
        units = TOGETHER[effect]
        off = [unit * (_value(found, key) - float(true[key])) for key, unit in units.items()]
        return float(np.linalg.norm(off) / np.linalg.norm([unit * float(true[key]) for key, unit in units.items()]))
    errors = []
    for key in EACH.get(effect, ()):
        value, truth = _value(found, key), float(true[key])
        value = abs(value) if effect in UNSIGNED else value
        errors.append(abs(value / truth - 1))
    return float(np.mean(errors)) if errors else math.nan


def _wave(found: Mapping[str, Any]) -> tuple[float, float]:
    return _value(found, "amplitude"), _value(found, "phase")


def _value(found: Mapping[str, Any], key: str) -> float:
    given = found.get(key)
    value = given.get("value") if isinstance(given, Mapping) else given
    return math.nan if value is None else float(value)
