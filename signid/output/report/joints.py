"""What a joint is, what it moves, and how far."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...types import Robot


class JointEntry(NamedTuple):
    """A line of the table of joints; limits in `unit`, `unit`/s and N.m or N, infinite where none is stated."""

    name: str
    number: int
    type: str
    link: str
    lower: float
    upper: float
    velocity_limit: float
    effort_limit: float
    unit: str


def describe_joints(robot: Robot) -> list[JointEntry]:
    """Every joint that moves by itself."""
    return [
        JointEntry(
            name,
            robot.numbers[j],
            _kind(robot, j),
            _link(robot, j),
            float(robot.lower[j]),
            float(robot.upper[j]),
            float(robot.velocity_limit[j]),
            float(robot.effort_limit[j]),
            "m" if robot.prismatic[j] else "rad",
        )
        for j, name in enumerate(robot.joints)
    ]


def _kind(robot: Robot, j: int) -> str:
    if robot.prismatic[j]:
        return "prismatic"
    return "revolute" if np.isfinite(robot.upper[j] - robot.lower[j]) else "continuous"


def _link(robot: Robot, j: int) -> str:
    """The link that the joint carries; links that follow by mimic joints come after it."""
    rows = np.flatnonzero(robot.drive[:, j])
    bodies = zip(list(robot.model.names)[1:], list(robot.model.joints)[1:], robot.links, strict=True)
    moved = [
        (name != robot.joints[j], link)
        for name, joint, link in bodies
        if np.any((rows >= joint.idx_v) & (rows < joint.idx_v + joint.nv))
    ]
    return min(moved, key=lambda entry: entry[0])[1] if moved else ""
