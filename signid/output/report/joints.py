"""Description of joints: type, link and limits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...types import Robot


class JointEntry(NamedTuple):
    """Row of the table of joints; limits in `unit`, `unit`/s and N.m or N, infinite if not stated."""

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
    """Describe the actuated joints."""
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
    """Name of the link that the joint moves; a joint's own link precedes links of mimic joints."""
    rows = np.flatnonzero(robot.drive[:, j])
    bodies = zip(list(robot.model.names)[1:], list(robot.model.joints)[1:], robot.links, strict=True)
    moved = [
        (name != robot.joints[j], link)
        for name, joint, link in bodies
        if np.any((rows >= joint.idx_v) & (rows < joint.idx_v + joint.nv))
    ]
    return min(moved, key=lambda entry: entry[0])[1] if moved else ""
