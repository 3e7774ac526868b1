"""Pinocchio configurations from joint positions."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import InputError
from ..types import Array, Robot


def configuration(robot: Robot, q: Array) -> Array:
    """Compute configurations of the model: mimic and held joints included, continuous joints as cos and sin.

    Args:
        robot: the robot.
        q: (N, n) joint positions [rad or m], or (n,) for one configuration.

    Returns:
        (N, nq) configurations [rad, m or 1], or (nq,).

    Raises:
        InputError: the last axis of q does not match the number of joints.
    """
    import pinocchio as pin

    q = np.asarray(q, float)
    n = len(robot.joints)
    if q.ndim == 0 or q.shape[-1] != n:
        raise InputError(f"positions of {robot.name} have shape {q.shape}; give one column for each of its {n} joints")
    position = q @ robot.drive.T + robot.rest  # (N, nv)
    result = np.empty((*q.shape[:-1], robot.model.nq))
    result[...] = pin.neutral(robot.model)
    for joint in list(robot.model.joints)[1:]:
        rows = slice(joint.idx_v, joint.idx_v + joint.nv)
        if joint.nq == 2 and joint.nv == 1:
            result[..., joint.idx_q] = np.cos(position[..., joint.idx_v])
            result[..., joint.idx_q + 1] = np.sin(position[..., joint.idx_v])
        elif is_plain(joint):
            result[..., joint.idx_q : joint.idx_q + joint.nq] = position[..., rows]
    return result


def is_plain(joint: Any) -> bool:
    """Whether the configuration of a model joint equals its positions: one axis, or several independent axes."""
    return bool(joint.nq == joint.nv and (joint.nv == 1 or joint.shortname() == "JointModelComposite"))
