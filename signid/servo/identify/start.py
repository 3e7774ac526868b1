"""Stated numbers of drives, the drives that a fit starts from, and the numbers that it may change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import OptionError, shorten
from ...servos import DRIVE_LAWS, KD_ON, SERVO_NUMBERS, Servo, ServoGrid, number_fault
from ...types import Robot
from ..search.choice import Candidate
from ..search.data import ServoData

ALWAYS = ("kp", "kd", "delay", "coulomb_friction", "armature", "torque_offset")
LEAST_LAG = 0.005  # [s] kd over kp to start from: a fit hardly leaves zero
LEAST_WAVE = 6e-4  # [s2] the same for armature over kp: 40 rad/s, the slowest of hobby servos have 12 to 41
MOVES = 0.02  # [rad/s or m/s] rms speed from which friction of a free joint acts
KNOWN = ("masses", "kp", "nothing")

Stated = Mapping[str, Mapping[str, float]]  # number by joint and name


def stated_numbers(robot: Robot, joints: Sequence[str]) -> dict[str, dict[str, float]]:
    """Numbers of each drive that the actuators file states."""
    return {
        joint: {key: float(x) for key, x in _entries(robot, joint).items() if key in SERVO_NUMBERS} for joint in joints
    }


def stated_drive(robot: Robot, joint: str) -> Servo:
    """Drive with what the actuators file states, and zero or no limit elsewhere."""
    entries = _entries(robot, joint)
    numbers = {key: float(x) for key, x in entries.items() if key in SERVO_NUMBERS}
    register = entries.get("kp_register")
    return Servo(
        law=str(entries.get("law", DRIVE_LAWS[0])),
        kd_on=str(entries.get("kd_on", KD_ON[0])),
        kp_register=None if register is None else float(register),
    ).with_(**numbers)


def stated_laws(robot: Robot, joints: Sequence[str], laws: Mapping[str, str] | str | None) -> dict[str, str]:
    """Law of each joint whose law is given, or stated by the actuators file.

    Raises:
        OptionError: unknown law or joint.
    """
    given = dict.fromkeys(joints, laws) if isinstance(laws, str) else dict(laws or {})
    if unknown := [joint for joint in given if joint not in joints]:
        raise OptionError(
            f"laws names {shorten(unknown)}, and the servo joints are {shorten(joints)}; give one of them"
        )
    if wrong := [law for law in given.values() if law not in DRIVE_LAWS]:
        raise OptionError(f"law {wrong[0]!r} is none of {', '.join(DRIVE_LAWS)}")
    filed = {joint: str(_entries(robot, joint)["law"]) for joint in joints if "law" in _entries(robot, joint)}
    return {**filed, **given}


def known_scale_of(known: str | None, stated: Stated) -> tuple[str, dict[str, dict[str, float]]]:
    """Origin of the scale, one of KNOWN, and the stated numbers with a gain that `known` gives, as in "kp=20".

    Raises:
        OptionError: unknown value.
    """
    numbers = {joint: dict(of) for joint, of in stated.items()}
    gains = any("kp" in of for of in numbers.values())
    if known is None:
        return ("kp" if gains else "masses"), numbers
    word, _, value = known.partition("=")
    if word == "kp" and value:
        gain = known_gain(known, value)
        return "kp", {joint: {**of, "kp": gain} for joint, of in numbers.items()}
    if word not in KNOWN or value:
        raise OptionError(f"known is {known!r}; give one of {', '.join(KNOWN)}, or kp=20, for example")
    if word == "kp" and not gains:
        raise OptionError("known is 'kp', and no kp is stated; state it in the actuators file, or give kp=20")
    return word, numbers


def known_gain(given: str, text: str) -> float:
    """Gain kp [N.m/rad] that a text states; `given` is the whole text of the user.

    Raises:
        OptionError: no number, or one that no drive has.
    """
    try:
        gain = float(text)
    except ValueError:
        gain = -1.0
    if fault := number_fault("kp", gain, positive=True):
        raise OptionError(f"known is {given!r}; {fault} as the gain, in N.m/rad; give kp=20, for example")
    return gain


def first_candidate(
    robot: Robot, data: ServoData, servos: Mapping[str, Servo], stated: Stated, laws: Mapping[str, str]
) -> Candidate:
    """Drives to start from, with stated numbers, and the numbers that are free with every law."""
    started, free = {}, list[tuple[str, str]]()
    for joint, servo in servos.items():
        numbers, nominal = stated.get(joint, {}), stated_drive(robot, joint)
        if "kp" in numbers and servo.kp > 0:
            scale = numbers["kp"] / servo.kp
            servo = servo.with_(**{key: scale * getattr(servo, key) for key in ("kd", "coulomb_friction", "armature")})
        if "kd" in numbers:
            servo = servo.with_(viscous_friction=max(servo.kd - numbers["kd"], 0.05 * servo.kd))
        servo = servo.with_(kd=max(servo.kd, LEAST_LAG * servo.kp), armature=max(servo.armature, LEAST_WAVE * servo.kp))
        law = laws.get(joint, DRIVE_LAWS[0])
        servo = replace(servo, law=law, kd_on=nominal.kd_on, kp_register=nominal.kp_register).with_(
            **{"effort_limit": np.inf, "speed_limit": np.inf, **numbers}
        )
        started[joint] = servo
        names = [name for name in ALWAYS if name not in numbers]
        if ("kd" in numbers or moves_while_off(data, joint)) and "viscous_friction" not in numbers:
            names.append("viscous_friction")
        free += [(joint, name) for name in names]
    return Candidate(started, tuple(free), usual={joint: servo.kp for joint, servo in started.items()})


def moves_while_off(data: ServoData, joint: str) -> bool:
    """Whether a joint moves in the training data while its drive is off."""
    return any(_rms_speed_off(grid, joint) > MOVES for grid in data.train)


def _rms_speed_off(grid: ServoGrid, joint: str) -> float:
    j = grid.joints.index(joint)
    off = grid.on[:, j] < 0.5
    if off.sum() < 5:
        return 0.0
    return float(np.sqrt(np.mean(np.gradient(grid.q[:, j], grid.step)[off] ** 2)))


def _entries(robot: Robot, joint: str) -> Mapping[str, Any]:
    servo: Mapping[str, Mapping[str, Any]] = getattr(robot, "servo", {})
    return servo.get(joint, {})
