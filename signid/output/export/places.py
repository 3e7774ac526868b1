"""Kinematic tree of a model as in MJCF: nested bodies, each with its axes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ...robot import configuration
from ...robot.dynamics import own_row
from ...robot.joints import is_plain
from ...types import Array, Robot


class AxisPlace(NamedTuple):
    """A joint axis: its row in the model, and its pose in the body."""

    row: int
    name: str
    slide: bool
    at: Array  # (3,) [m]
    direction: Array  # (3,) [1]


class Place(NamedTuple):
    """A body: parent joint of the model, pose in the parent at zero, and axes."""

    parent: int
    pose: Any  # pin.SE3
    axes: tuple[AxisPlace, ...]


class Follower(NamedTuple):
    """A mimic joint: position = offset + scale * position of the leader."""

    name: str
    leader: str
    offset: float
    scale: float


def places(robot: Robot) -> list[Place]:
    """List the bodies of the model; held joints are part of the pose of their body."""
    at_zero = configuration(robot, np.zeros(len(robot.joints)))
    leaders = {own_row(robot, j): name for j, name in enumerate(robot.joints)}
    found = []
    for i in range(1, robot.model.njoints):
        pose, frames = robot.model.jointPlacements[i], []
        for joint, before in _parts(robot.model.joints[i]):
            pose = pose * before
            state = joint.createData()
            joint.calc(state, at_zero)
            if robot.drive[joint.idx_v : joint.idx_v + joint.nv].any():
                frames.append((joint.idx_v, pose, np.asarray(state.S, float).reshape(6, -1)[:, 0]))
            else:
                pose = pose * state.M
        name = str(robot.model.names[i])
        axes = [_axis(leaders.get(row, name), row, pose.actInv(frame), axis) for row, frame, axis in frames]
        found.append(Place(int(robot.model.parents[i]), pose, tuple(axes)))
    return found


def followers(robot: Robot) -> list[Follower]:
    """List the mimic joints."""
    own = {own_row(robot, j) for j in range(len(robot.joints))}
    return [
        Follower(axis.name, robot.joints[j], float(robot.rest[axis.row]), float(robot.drive[axis.row, j]))
        for place in places(robot)
        for axis in place.axes
        if axis.row not in own
        for j in np.flatnonzero(robot.drive[axis.row])[:1]
    ]


def _parts(joint: Any) -> list[tuple[Any, Any]]:
    """Parts of a composite joint with their relative placements, or the joint itself."""
    if joint.shortname() != "JointModelComposite" or not is_plain(joint):
        return [(joint, pin.SE3.Identity())]
    whole = joint.extract()
    return list(zip(whole.joints, whole.jointPlacements, strict=True))


def _axis(name: str, row: int, frame: Any, motion: Array) -> AxisPlace:
    slide = bool(np.any(motion[:3]))
    return AxisPlace(
        row, name, slide, frame.translation, frame.rotation @ motion[:3] if slide else frame.rotation @ motion[3:]
    )
