"""Stated numbers of drives, the drives that a fit starts from, and the numbers that it may change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import OptionError, shorten
from ...servos import DRIVE_LAWS, KD_ON, SERVO_NUMBERS, Servo, ServoGrid
from ...types import Robot
from ..assumptions import Assumptions
from ..search.choice import Candidate
from ..search.data import ServoData

ALWAYS = ("kp", "kd", "delay", "coulomb_friction", "armature", "torque_offset")
LEAST_LAG = 0.005  # [s] kd over kp to start from: a fit hardly leaves zero
LEAST_WAVE = 6e-4  # [s2] the same for armature over kp: 40 rad/s, the slowest of hobby servos have 12 to 41
MOVES = 0.02  # [rad/s or m/s] rms speed from which friction of a free joint acts

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


def stated_laws(
    robot: Robot, joints: Sequence[str], laws: Mapping[str, str] | str | None, assumptions: Assumptions
) -> dict[str, str]:
    """Law of each joint whose law is given, or stated by the actuators file; equal joints have the same.

    Raises:
        OptionError: unknown law or joint, or equal joints of different laws.
    """
    given = dict.fromkeys(joints, laws) if isinstance(laws, str) else dict(laws or {})
    if unknown := [joint for joint in given if joint not in joints]:
        raise OptionError(
            f"laws names {shorten(unknown)}, and the servo joints are {shorten(joints)}; give one of them"
        )
    if wrong := [law for law in given.values() if law not in DRIVE_LAWS]:
        raise OptionError(f"law {wrong[0]!r} is none of {', '.join(DRIVE_LAWS)}")
    filed = {joint: str(_entries(robot, joint)["law"]) for joint in joints if "law" in _entries(robot, joint)}
    found = {**filed, **given}
    for members in assumptions.equal:
        stated = {found[joint] for joint in members if joint in found}
        if len(stated) > 1:
            raise OptionError(
                f"{shorten(members)} are equal, and have the laws {' and '.join(sorted(stated))}; give one"
            )
        found |= {joint: law for joint in members for law in stated}
    return found


def first_candidate(
    robot: Robot,
    data: ServoData,
    servos: Mapping[str, Servo],
    stated: Stated,
    laws: Mapping[str, str],
    assumptions: Assumptions = Assumptions(),  # noqa: B008
) -> Candidate:
    """Drives to start from, with stated numbers and means of priors, and the numbers that are free with every law."""
    started, free = {}, list[tuple[str, str]]()
    for joint, servo in servos.items():
        numbers, nominal = stated.get(joint, {}), stated_drive(robot, joint)
        means = {name: prior.mean for (one, name), prior in assumptions.priors.items() if one == joint}
        if "kp" in numbers and servo.kp > 0:
            scale = numbers["kp"] / servo.kp
            servo = servo.with_(**{key: scale * getattr(servo, key) for key in ("kd", "coulomb_friction", "armature")})
        if "kd" in numbers:
            servo = servo.with_(viscous_friction=max(servo.kd - numbers["kd"], 0.05 * servo.kd))
        servo = servo.with_(kd=max(servo.kd, LEAST_LAG * servo.kp), armature=max(servo.armature, LEAST_WAVE * servo.kp))
        law = laws.get(joint, DRIVE_LAWS[0])
        servo = replace(servo, law=law, kd_on=nominal.kd_on, kp_register=nominal.kp_register).with_(
            **{"effort_limit": np.inf, "speed_limit": np.inf, **numbers, **means}
        )
        started[joint] = servo
        names = [name for name in (*ALWAYS, *means) if name not in numbers]
        if ({"kd"} & {*numbers, *means} or moves_while_off(data, joint)) and "viscous_friction" not in numbers:
            names.append("viscous_friction")
        free += [(joint, name) for name in names]
    usual = {joint: servo.kp for joint, servo in started.items()}
    return Candidate(started, tuple(dict.fromkeys(free)), usual=usual, assumptions=assumptions)


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
