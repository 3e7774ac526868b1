"""Export of position drives as a Python function without packages: expected positions by commands."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pinocchio as pin

from ...errors import OptionError, one_line
from ...model import Model
from ...robot import configuration
from ...robot.dynamics import joint_inertia
from ...servos import SERVO_NUMBERS, Servo
from ...types import Array
from .bodies import Exported
from .drives import known_document

_HEAD = '''"""Positions that the joints of {name} should reach, from their commanded positions; needs no package.

    found = expected([0.0, 0.02, ...], {{"{first}": [0.1, 0.12, ...]}})["{first}"]

Each joint is simulated alone: its drive, dry and viscous friction and a constant inertia [{inertia}], without gravity,
the other joints and contacts.
"""

MOTORS = {motors}
NONE = {none}  # numbers without an effect, where MOTORS has none
'''
_BODY = '''

def expected(times, commands, start=None, step=0.001):
    """Expected position of each joint at each time, by its name [rad or m].

    times: stamps of the commands [s], ascending; commands: positions by joint [rad or m], each held until the next;
    start: positions at the first stamp by joint, else the first commands; step: largest time step [s].
    """
    return {joint: _follow({**NONE, **MOTORS[joint]}, times, list(command), (start or {}).get(joint, command[0]), step)
            for joint, command in commands.items()}


def _follow(m, times, command, q, step):
    v, target, k, found = 0.0, command[0], 0, [q]
    for before, after in zip(times, times[1:]):
        count = max(1, int((after - before) / step + 0.999999))
        h = (after - before) / count
        for i in range(count):
            t = before + (i + 0.5) * h - m["delay"]
            while k + 1 < len(times) and times[k + 1] <= t:
                k += 1
            change = m.get("profile_speed", float("inf")) * h
            target += min(max(command[k] - target, -change), change)
            half = q + 0.5 * h * v
            v = _speed(m, v, target - half, h)
            q = half + 0.5 * h * v
        found.append(q)
    return found


def _speed(m, v, error, h):
    """Speed after a time h; friction can stop a joint, not turn it."""
    error = max(abs(error) - m["dead_band"], 0.0) * (1.0 if error > 0 else -1.0)
    limit, damping, torque = m.get("effort_limit", float("inf")), m["kd"], m["kp"] * error
    if m["law"] == "duty":
        torque = min(max(torque, -limit), limit)
    else:
        total = torque - damping * v
        if m["law"] == "torque_speed" and total * v > 0:
            limit *= max(1.0 - abs(v) / m.get("speed_limit", float("inf")), 0.0)
        if abs(total) > limit:
            torque, damping = (limit if total > 0 else -limit), 0.0
    sag = 1.0 + m["droop"] * abs(torque - damping * v)
    torque, damping = torque / sag, damping / sag
    dry = m["coulomb_friction"] + m["load_friction"] * abs(torque - damping * v)
    damping += m["viscous_friction"]
    push = (m["inertia"] - 0.5 * h * damping) * v + h * (torque - m["torque_offset"])
    slip = abs(push) - h * dry
    return (slip if push > 0 else -slip) / (m["inertia"] + 0.5 * h * damping) if slip > 0 else 0.0
'''


def write_expected(model: Model) -> Exported:
    """Write a Python file without imports: `expected(times, commands)`, the positions that the joints should reach.

    Raises:
        OptionError: the model has no position drive.
    """
    motors = _motors(model)
    notes = ["gravity, coupling of the joints and contacts are not in the function"]
    if any(servo.kd_on == "error" for servo in model.servos.values()):
        notes.append("kd acts on the speed in the function, not on its error")
    rows = "".join(f"    {joint!r}: {motor!r},\n" for joint, motor in motors.items())
    text = _HEAD.format(
        name=_plain(model.robot.name),
        first=_plain(next(iter(motors))),
        inertia="kg.m2 or kg, in the middle of the ranges",
        motors="{\n" + rows + "}",
        none=repr({name: 0.0 for name in SERVO_NUMBERS if getattr(Servo, name) == 0.0}),
    )
    return Exported(text + _BODY, tuple(notes))


def _motors(model: Model) -> dict[str, dict[str, Any]]:
    """Numbers of the drives by joint, with lag, inertia and the error that friction can leave."""
    if not model.servos:
        raise OptionError(
            f"--expected needs a model with position drives, and {model.robot.name} has none; "
            f"give the model.json that `signid identify --servo` wrote"
        )
    inertia = dict(zip(model.robot.joints, _inertia(model).tolist(), strict=True))
    found = {}
    for joint, numbers in known_document(model.servos, model.robot.joints).items():
        servo = model.servos[joint]
        derived = {"inertia": inertia[joint], "lag": servo.lag, "standing_error": _standing(servo)}
        found[joint] = {**numbers, **{key: float(x) for key, x in derived.items() if np.isfinite(x)}}
    return found


def _standing(servo: Servo) -> float:
    """Largest error [rad or m] at which dry friction and dead band hold a joint without load."""
    return servo.dead_band + servo.coulomb_friction / servo.kp if servo.kp > 0 else np.inf


def _inertia(model: Model) -> Array:
    """Inertia of each joint alone with its armature, (n,) [kg.m2 or kg], in the middle of its range or at zero."""
    robot, whole = model.robot, model.bodies()
    ends = np.isfinite(robot.lower) & np.isfinite(robot.upper)
    middle = np.where(ends, (np.where(ends, robot.lower, 0.0) + np.where(ends, robot.upper, 0.0)) / 2, 0.0)
    return np.asarray(np.diag(joint_inertia(robot, pin.crba(whole, whole.createData(), configuration(robot, middle)))))


def _plain(text: str) -> str:
    return re.sub(r'["\\{}]', "_", one_line(text))
