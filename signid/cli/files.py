"""The files that hold an identification."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..errors import RobotError

if TYPE_CHECKING:
    from ..identify import Identification
    from ..types import Array


def with_urdf(result: Identification) -> tuple[Identification, dict[str, str]]:
    """The robot's URDF with what was identified, as a file; where there is none, the result's notes say why."""
    from ..export import urdf_with

    robot = result.robot
    if robot.kind != "urdf":
        why = f"the robot comes from {robot.kind.upper()}"
    else:
        try:
            friction = (_friction(result, name) for name in ("viscous_friction", "coulomb_friction"))
            return result, {"robot.urdf": urdf_with(robot, _told_bodies(result), *friction)}
        except RobotError as error:
            why = str(error)
    return replace(result, notes=(*result.notes, f"robot.urdf is not written: {why}")), {}


def _told_bodies(result: Identification) -> Array:
    """(nb, 10) inertial parameters [kg, kg.m, kg.m2]; NaN for bodies that torque does not show."""
    bodies = result.parameters.bodies().copy()
    shown = np.any(result.base.combination != 0, axis=0)
    for body in range(len(bodies)):
        if not any(s for s, label in zip(shown, result.base.labels, strict=True) if label.body == body):
            bodies[body] = np.nan
    return bodies


def _friction(result: Identification, effect: str) -> Array:
    """(n,) the coefficient of a law [N.m.s/rad or N.m], NaN at joints without it; none less than nothing."""
    values = np.full(len(result.robot.joints), np.nan)
    for law in result.model.laws:
        if law.effect.name == effect:
            values[list(law.joints)] = max(0.0, *law.parameters.values())
    return values
