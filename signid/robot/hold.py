"""A robot with some of its joints held fixed."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import fields, replace
from math import isfinite, nan
from typing import Any

import numpy as np

from ..errors import RobotError, shorten
from ..types import Actuators, Robot
from .joints import find


def hold(robot: Robot, positions: Mapping[str, float]) -> Robot:
    """Hold joints (by name or number) at given positions [rad or m]; their mimic joints follow.

    Raises:
        RobotError: unknown or repeated joint, position that is not finite, or no joint left to move.
    """
    if not positions:
        return robot
    held: dict[int, float] = {}
    for joint, value in positions.items():
        i = find(joint, robot.joints, robot.numbers, robot.name)
        if i in held:
            raise RobotError(f"joint {robot.joints[i]} of {robot.name} has two positions to be held at; give one")
        held[i] = _position(robot.joints[i], value)
    keep = [i for i in range(len(robot.joints)) if i not in held]
    if not keep:
        raise RobotError(f"every joint of {robot.name} would be held fixed; leave at least one to move")
    return replace(
        robot,
        joints=tuple(robot.joints[i] for i in keep),
        numbers=tuple(robot.numbers[i] for i in keep),
        drive=robot.drive[:, keep],
        rest=robot.rest + sum((robot.drive[:, i] * value for i, value in held.items()), np.zeros(len(robot.rest))),
        prismatic=robot.prismatic[keep],
        lower=robot.lower[keep],
        upper=robot.upper[keep],
        velocity_limit=robot.velocity_limit[keep],
        effort_limit=robot.effort_limit[keep],
        actuators=Actuators(*(getattr(robot.actuators, item.name)[keep] for item in fields(Actuators))),
        notes=(*robot.notes, _note(robot, held)),
    )


def resting(robot: Robot, but: Collection[str] = ()) -> dict[str, float]:
    """Rest positions [rad or m] of all joints except `but`: zero, or the nearest position within the limits."""
    rest = np.clip(0.0, robot.lower, robot.upper)
    return {joint: float(rest[i]) for i, joint in enumerate(robot.joints) if joint not in but}


def _position(joint: str, value: Any) -> float:
    try:
        number = nan if isinstance(value, bool | str) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = nan
    if not isfinite(number):
        raise RobotError(f"joint {joint} cannot be held at {value!r}; give a finite number in rad or m")
    return number


def _note(robot: Robot, held: Mapping[int, float]) -> str:
    each = [f"{robot.joints[i]} at {held[i]:.6g} {'m' if robot.prismatic[i] else 'rad'}" for i in sorted(held)]
    return f"held fixed: {shorten(each)}"
