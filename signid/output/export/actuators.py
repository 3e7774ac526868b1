"""Export of a model's actuators as actuators.toml."""

from __future__ import annotations

import json
import re
from collections.abc import Collection
from dataclasses import fields

import numpy as np

from ...model import Model
from ...types import Actuators, Array
from .beyond import Exported, held, lacking, remarks, summed

_UNITS = {
    "armature": "kg.m2",
    "viscous_friction": "N.m.s/rad",
    "coulomb_friction": "N.m",
    "torque_offset": "N.m",
    "torque_constant": "N.m/A",
}
_BARE = re.compile(r"[A-Za-z0-9_-]+")


def write_actuators(model: Model) -> Exported:
    """Write an actuators file (TOML): armature, friction, offset and torque constant of each joint.

    Values that the description states and the model lacks are zero, since the file overrides the description.
    """
    drives, beyond = driven(model)
    notes = tuple(f"an actuators file cannot hold {laws}" for laws in beyond)
    head = f"Actuators of {model.robot.name}; prismatic joints: N for N.m, m for rad, kg for kg.m2"
    lines = remarks([head, *notes]).splitlines()
    for joint, stated in drives.items():
        if stated:
            lines += ["", f"[joint.{joint if _BARE.fullmatch(joint) else json.dumps(joint, ensure_ascii=False)}]"]
            lines += [f"{key} = {value!r}  # {_UNITS[key]}" for key, value in stated.items()]
    return Exported("\n".join(lines) + "\n", notes)


def driven(model: Model, but: Collection[str] = ()) -> tuple[dict[str, dict[str, float]], list[str]]:
    """Return actuator parameters by joint and key, and the laws of the model that they omit, in words.

    Args:
        model: rigid bodies and laws.
        but: effects whose omission is not reported.
    """
    robot = model.robot
    values = {item.name: _values(model, item.name) for item in fields(Actuators)}
    kept = [law for law in model.laws if law.effect.name in ("torque_offset", *but)]
    beyond = lacking(robot, model.laws, [*held(model, ("armature", "viscous_friction", "coulomb_friction")), *kept])
    stated = {
        joint: {key: float(value[j]) for key, value in values.items() if np.isfinite(value[j])}
        for j, joint in enumerate(robot.joints)
    }
    return stated, [beyond] if beyond else []


def _values(model: Model, key: str) -> Array:
    """Values of a key, (n,) [the unit of the key]; NaN if not written."""
    stated = getattr(model.robot.actuators, key)
    if key == "torque_constant":
        return np.asarray(stated)
    total = summed(model, key)
    if key != "torque_offset":
        total = np.where(total < 0, np.nan, total)
    return np.where(np.isnan(total) & np.isfinite(stated), 0.0, total)
