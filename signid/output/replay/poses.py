"""Forward kinematics of a robot's bodies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from ...robot import configuration
from ...robot.dynamics import joint_of_row, own_row
from ...types import Array, Robot


def poses(robot: Robot, q: Array, bodies: Sequence[int]) -> Array:
    """Compute position [m] and quaternion x, y, z, w [1] of bodies in the world, (F, len(bodies), 7).

    The positions q: (F, n) [rad or m] may be NaN; bodies are named by the joints of the model that carry them.
    """
    model, data = robot.model, robot.model.createData()
    out = np.full((len(q), len(bodies), 7), np.nan)
    known = np.isfinite(q).all(axis=1)
    for frame, where in zip(np.flatnonzero(known), configuration(robot, q[known]), strict=True):
        pin.forwardKinematics(model, data, where)
        out[frame] = [pin.SE3ToXYZQUAT(data.oMi[body]) for body in bodies]
    return out


def movers(robot: Robot, bodies: Sequence[int]) -> list[int]:
    """Index of the joint that moves each body, or its parent if the body's joint is held; -1: base."""
    model, found = robot.model, [-1] * robot.model.njoints
    for joint in range(1, model.njoints):
        item = model.joints[joint]
        felt = np.abs(robot.drive[item.idx_v : item.idx_v + item.nv]).max(axis=0)
        found[joint] = int(np.argmax(felt)) if felt.any() else found[model.parents[joint]]
    return [found[body] for body in bodies]


def axis(robot: Robot, joint: int) -> tuple[int, Array, bool]:
    """The body that a joint moves, its axis in the body frame, (3,) [1], and whether it is prismatic."""
    row = own_row(robot, joint)
    body = joint_of_row(robot.model, row)
    return body, *_along(robot.model, body, row)


def own_axis(robot: Robot, body: int) -> tuple[Array, bool]:
    """The axis of a joint of the model in its frame, (3,) [1], and whether it is prismatic."""
    return _along(robot.model, body, robot.model.joints[body].idx_v)


def _along(model: Any, body: int, row: int) -> tuple[Array, bool]:
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    column = np.reshape(pin.getJointJacobian(model, data, body, pin.LOCAL), (6, model.nv))[:, row]
    slides = not column[3:].any()
    along = column[:3] if slides else column[3:]
    return along / np.linalg.norm(along), slides
