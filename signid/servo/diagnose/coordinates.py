"""Free numbers of drives as coordinates of an optimiser: logarithms of positive ones, else scaled values."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...servos import Servo
from ...types import Array
from .closed_loop import Point

LOGARITHMIC = ("kp", "effort_limit", "speed_limit", "profile_speed", "armature", "stribeck_velocity")
CAREFUL = ("effort_limit", "speed_limit", "profile_speed")  # their cost is flat beyond the motion: small steps
SIGNED = ("torque_offset", "position_phase", "spring_rest")
SMALLEST = 1e-6
BODY = ("mass", "first_moment_x", "first_moment_y", "first_moment_z")


class Free(NamedTuple):
    """One free number: of the drive of a joint of the group, or of the body at the last link (joint -1)."""

    joint: int
    number: str


class Scale(NamedTuple):
    """Typical sizes at a joint, for steps of numbers that may be zero."""

    effort: float  # [N.m]
    speed: float  # [rad/s]
    step: float  # between rows [s]


def value(point: Point, free: Free) -> float:
    """Value of a number [unit of the number]."""
    if free.joint < 0:
        return 0.0 if point.body is None else point.body[BODY.index(free.number)]
    return float(getattr(point.servos[free.joint], free.number))


def coordinate(point: Point, free: Free) -> float:
    """Coordinate of a number."""
    x = value(point, free)
    return float(np.log(max(x, SMALLEST))) if free.number in LOGARITHMIC else x


def with_coordinates(point: Point, frees: list[Free], x: Array) -> Point:
    """Point with other coordinates x: (P,) [of their units]; numbers stay within their physical bounds."""
    servos, body = list(point.servos), None if point.body is None else list(point.body)
    for free, at in zip(frees, x.tolist(), strict=True):
        number = float(np.exp(at)) if free.number in LOGARITHMIC else at
        if free.joint < 0:
            assert body is not None
            body[BODY.index(free.number)] = max(number, 1e-4) if free.number == "mass" else number
            continue
        if free.number not in SIGNED:
            number = max(number, 0.0)
        servos[free.joint] = servos[free.joint].with_(**{free.number: number})
    return Point(tuple(servos), None if body is None else (body[0], body[1], body[2], body[3]))


def difference(free: Free, servo: Servo | None, scale: Scale) -> float:
    """Step of a central difference in the coordinate."""
    if servo is None:
        return 0.01 if free.number == "mass" else 1e-3
    slope = scale.effort / max(scale.speed, 1e-6)
    sizes = {
        "kd": 0.02 * max(servo.damping, 0.05 * slope),
        "viscous_friction": 0.02 * max(servo.damping, 0.05 * slope),
        "coulomb_friction": max(0.05 * servo.coulomb_friction, 0.005 * scale.effort),
        "load_friction": 0.01,
        "torque_offset": 0.005 * scale.effort,
        "dead_band": max(0.05 * servo.dead_band, 3e-4),
        "delay": 0.1 * scale.step,
        "droop": 0.02 / max(scale.effort, 1e-9),
        "stribeck_level": max(0.05 * servo.stribeck_level, 0.005 * scale.effort),
        "position_amplitude": max(0.05 * servo.position_amplitude, 0.005 * scale.effort),
        "position_phase": 0.05,
        "spring_stiffness": max(0.05 * servo.spring_stiffness, 0.005 * scale.effort),
        "spring_rest": 0.02,
        "backlash_gap": max(0.05 * servo.backlash_gap, 3e-4),
    }
    return sizes.get(free.number, 0.02)


def longest(free: Free, servo: Servo | None, scale: Scale) -> float:
    """Longest step of the optimiser in the coordinate."""
    if free.number in LOGARITHMIC:
        return 0.15 if free.number in CAREFUL else 0.7
    return 30.0 * difference(free, servo, scale)


def own_numbers(point: Point, j: int) -> list[Free]:
    """Numbers that a drive has, without those that its law leaves out."""
    servo = point.servos[j]
    names = ["kp", "kd" if servo.kd > 0 else "viscous_friction", "coulomb_friction", "armature", "delay"]
    names += [name for name in ("effort_limit", "speed_limit") if np.isfinite(getattr(servo, name))]
    names += [name for name in ("load_friction", "dead_band", "droop") if getattr(servo, name) > 0]
    return [Free(j, name) for name in names]
