"""Export of a model's actuators: actuators.toml, and parameters of a ROS 2 node."""

from __future__ import annotations

import re
from dataclasses import fields
from typing import Any

import numpy as np
import pinocchio as pin

from ...errors import one_line
from ...model import Model
from ...recording.names.mapping import quoted
from ...servos import PASSIVE, SERVO_NUMBERS, SERVO_UNITS, Servo
from ...types import Actuators, Array
from .bodies import BODIES, Exported, beyond, fixed_note, remarks, summed
from .drives import known_document, left_out
from .training import FIELDS

_UNITS = {
    "armature": "kg.m2",
    "viscous_friction": "N.m.s/rad",
    "coulomb_friction": "N.m",
    "torque_offset": "N.m",
    "torque_constant": "N.m/A",
}
_BARE = re.compile(r"[A-Za-z0-9_-]+")
HEAD = """\
# Dynamics of {name} as parameters of a ROS 2 node: --param-file FILE of a controller's spawner, or parameters=[FILE] in
# a launch file. kg, m, s, rad, N, N.m; prismatic joints: N for N.m, m for rad, kg for kg.m2. Recorded torque = rigid
# bodies + armature * acceleration + viscous_friction * velocity + coulomb_friction * sign(velocity) + torque_offset.
# effort_limit is stated by the description. Inertia is about the centre of mass, along the axes of the link's joint
# frame.
"""


def write_actuators(model: Model) -> Exported:
    """Write an actuators file (TOML): armature, friction, offset, torque constant and position drive of each joint.

    Values that the description states and the model lacks are zero, since the file overrides the description.
    """
    notes = beyond("an actuators file", model, FIELDS, ("torque_offset",)) + _droop_note(model)
    head = f"Actuators of {model.robot.name}; prismatic joints: N for N.m, m for rad, kg for kg.m2"
    lines = remarks([head, *notes]).splitlines()
    for joint, stated in _driven(model).items():
        table = f"joint.{joint if _BARE.fullmatch(joint) else quoted(joint)}"
        if stated:
            lines += ["", f"[{table}]", *(f"{key} = {value!r}  # {_UNITS[key]}" for key, value in stated.items())]
        if joint in model.servos:
            lines += ["", f"[{table}.servo]", *_servo_lines(model.servos[joint])]
    return Exported("\n".join(lines) + "\n", tuple(notes))


def _servo_lines(servo: Servo) -> list[str]:
    """Keys of a drive that are not keys of its joint; numbers without an effect or not known are left out."""
    lines = [f'law = "{servo.law}"', *([f'kd_on = "{servo.kd_on}"'] if servo.kd_on != Servo.kd_on else [])]
    for key in (name for name in SERVO_NUMBERS if name not in (*PASSIVE, "droop", *left_out(servo))):
        value = float(getattr(servo, key))
        if np.isfinite(value) and (value > 0 or key in ("kd", "delay")):
            known = "; not identifiable, as stated before" if key in servo.not_identifiable else ""
            lines.append(f"{key} = {value!r}  # {SERVO_UNITS[key]}{known}")
    return [*lines, *([] if servo.kp_register is None else [f"kp_register = {float(servo.kp_register)!r}"])]


def _droop_note(model: Model) -> list[str]:
    joints = [joint for joint in model.robot.joints if joint in model.servos and model.servos[joint].droop > 0]
    return [f"an actuators file cannot hold the droop of the torque (droop) of {', '.join(joints)}"] if joints else []


def _driven(model: Model) -> dict[str, dict[str, float]]:
    """Actuator parameters by joint and key."""
    values = {item.name: _values(model, item.name) for item in fields(Actuators)}
    return {
        joint: {key: float(value[j]) for key, value in values.items() if np.isfinite(value[j])}
        for j, joint in enumerate(model.robot.joints)
    }


def _values(model: Model, key: str) -> Array:
    """Values of a key, (n,) [the unit of the key]; NaN if not written."""
    stated = getattr(model.robot.actuators, key)
    if key == "torque_constant":
        return np.asarray(stated)
    total = summed(model, key)
    if key != "torque_offset":
        total = np.where(total < 0, np.nan, total)
    return np.where(np.isnan(total) & np.isfinite(stated), 0.0, total)


def write_ros(model: Model) -> Exported:
    """Write a parameter file (YAML): actuator parameters, effort limits and drives per joint, inertials per link."""
    from yaml import safe_dump

    robot, bodies = model.robot, list(model.bodies().inertias)[1:]
    drives = _driven(model)
    for joint, limit in zip(robot.joints, robot.effort_limit.tolist(), strict=True):
        drives[joint] |= {"effort_limit": limit} if 0 < limit < np.inf else {}
    parameters = {
        "joints": list(robot.joints),
        "joint": {joint: stated for joint, stated in drives.items() if stated},
        **({"servo": known_document(model.servos, robot.joints)} if model.servos else {}),
        "link": {link: _inertial(body) for link, body in zip(robot.links, bodies, strict=True)},
    }
    parameters = {key: x for key, x in parameters.items() if x}  # rcl takes what follows an empty map for its content
    lacks = beyond("a ROS parameter file", model, FIELDS, ("torque_offset", *BODIES))
    lacks += fixed_note(robot, "their links are listed nevertheless")
    text = safe_dump({"/**": {"ros__parameters": {"dynamics": parameters}}}, sort_keys=False, allow_unicode=True)
    return Exported(HEAD.format(name=one_line(robot.name)) + remarks(lacks) + text, tuple(lacks))


def _inertial(body: pin.Inertia) -> dict[str, Any]:
    xx, xy, xz, _, yy, yz, *_, zz = np.asarray(body.inertia).ravel().tolist()
    moments = {"ixx": xx, "ixy": xy, "ixz": xz, "iyy": yy, "iyz": yz, "izz": zz}
    return {"mass": float(body.mass), "centre_of_mass": np.asarray(body.lever).tolist(), "inertia": moments}
