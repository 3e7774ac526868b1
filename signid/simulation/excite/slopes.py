"""Derivatives of a weighted sum of the regressor's entries by the motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ...regression.motion import Motion, law_rows
from ...types import Array, Indices, Law

LAW_STEPS = np.array([1e-6, 1e-6, 1e-3])  # [rad, rad/s, rad/s2] steps of the laws' numerical derivatives


def row_slopes(motion: Motion, laws: Sequence[Law], wanted: Sequence[Indices], weights: Sequence[Array]) -> Array:
    """Derivatives (3, N, n) by position, velocity and acceleration of the sum of weights * `base_rows`, per sample.

    The weights (N, m_j) of each joint's rows are constant. Those of laws, each of which acts at one joint only, are
    derived by differences; those of bodies exactly, from the inertial parameters that the weights would be.

    Source: derivatives of the joints' axes as in Carpentier, Mansard, Robotics: Science and Systems, 2018.
    """
    rigid = 10 * len(motion.robot.links)
    split = [int(np.searchsorted(columns, rigid)) for columns in wanted]
    further = [columns[k:] - rigid for columns, k in zip(wanted, split, strict=True)]
    near = (
        np.array([motion.q, motion.v, motion.a])[:, None]
        + np.pad(np.diag(LAW_STEPS), ((0, 0), (1, 0)))[..., None, None]
    )
    q, v, a = near.reshape(3, -1, near.shape[-1])
    found = law_rows(replace(motion, t=np.tile(motion.t, 4), q=q, v=v, a=a), laws, further)
    out = np.zeros((3, *motion.q.shape))
    for j, (x, weight, at) in enumerate(zip(found, weights, split, strict=True)):
        each = x.reshape(4, *weight[:, at:].shape)
        out[:, :, j] = ((each[1:] - each[0]) * weight[:, at:]).sum(axis=2) / LAW_STEPS[:, None]
    drive = motion.robot.drive
    moving = np.flatnonzero(drive.any(axis=1))
    by_row = np.zeros((rigid, len(moving), len(motion)))
    for j, (columns, weight, at) in enumerate(zip(wanted, weights, split, strict=True)):
        for row in np.flatnonzero(drive[moving, j]):
            by_row[columns[:at], row] += drive[moving[row], j] * weight[:, :at].T
    return out + _rigid_slopes(motion, moving, by_row.reshape(-1, 10, *by_row.shape[1:])) @ drive[moving]


def _rigid_slopes(motion: Motion, moving: Indices, weights: Array) -> Array:
    """Derivatives (3, N, m) by the m moving rows of the model; weights (nb, 10, m, N) of bodies' inertial parameters.

    Spatial vectors are (6, ..., N), linear part first, in the frame of the world unless said otherwise.
    """
    model, (v, a) = motion.robot.model, motion.rates
    joints = [i for i in range(1, model.njoints) for _ in range(model.joints[i].nv)]
    owner = [joints[k] for k in moving]
    above = np.array([[joint in path for joint in owner] for path in map(set, model.supports)])  # rows that move a body
    body, row = np.nonzero(above[1:] & weights.any(axis=(1, 3)))
    axes, places = np.empty((len(motion), 6, len(moving))), np.empty((len(motion), model.njoints, 4, 4))
    data = model.createData()
    for i, q in enumerate(motion.configuration):
        axes[i] = np.reshape(pin.computeJointJacobians(model, data, q), (6, -1))[:, moving]
        places[i] = [place.homogeneous for place in data.oMi]
    s = np.ascontiguousarray(axes.transpose(1, 2, 0))
    place = np.ascontiguousarray(places[:, body + 1].transpose(2, 3, 1, 0))
    before = above[owner].astype(float)  # (m, m) rows before each, with itself
    own = s * v[:, moving].T
    velocity = before @ own
    change = s * a[:, moving].T + _cross(velocity, own)
    acceleration = before @ change - np.append(model.gravity.linear, np.zeros(3))[:, None, None]
    last = np.array([np.flatnonzero(up)[-1] if up.any() else 0 for up in above])[body + 1]

    turn, shift = place[:3, :3], place[:3, 3]
    x = np.array([s[:, row], velocity[:, last], acceleration[:, last]]).swapaxes(0, 1)
    linear, angular = x[:3] + _cross3(x[3:], shift[:, None]), x[3:]
    x = np.concatenate([np.einsum("ba...,bc...->ac...", turn, y) for y in (linear, angular)])  # in the body's frame
    axis, speed = x[:, 0], x[:, 1]
    force = _momentum(weights[body, :, row].swapaxes(0, 1), np.concatenate([x, _cross(axis, speed)[:, None]], axis=1))
    axial, momentum, inertial, turned = force.swapaxes(0, 1)
    forces = np.array(
        [
            axial,
            turned - _dual(axis, momentum) + _dual(speed, axial),
            _dual(axis, inertial + _dual(speed, momentum)),
        ]
    ).swapaxes(0, 1)
    linear, angular = (np.einsum("ab...,bc...->ac...", turn, y) for y in (forces[:3], forces[3:]))
    forces = np.concatenate([linear, angular + _cross3(shift[:, None], linear)])
    below = above[body + 1].T  # (m, pairs)
    ahead = below & (before.T[row].T > 0) & (row != np.arange(len(moving))[:, None])
    mass, rest = below.astype(float) @ forces[:, 0], below.astype(float) @ forces[:, 1]
    velocity, acceleration = velocity - own, acceleration - change  # of the body before
    drag = _dual(velocity, mass)
    place_slope = ahead.astype(float) @ forces[:, 2] + _dual(acceleration, mass) + _dual(velocity, rest - drag)
    return np.einsum("kcmn,cmn->knm", np.array([-place_slope, rest - 2 * drag, mass]), s)


def _momentum(inertial: Array, x: Array) -> Array:
    """Momentum (6, c, ...) of inertial parameters (10, ...) at velocities x (6, c, ...), in the body's frame."""
    m, h, (xx, xy, yy, xz, yz, zz) = inertial[0], inertial[1:4, None], inertial[4:]
    linear, (a, b, c) = x[:3], x[3:]
    turning = np.array([xx * a + xy * b + xz * c, xy * a + yy * b + yz * c, xz * a + yz * b + zz * c])
    return np.concatenate([m * linear + _cross3(x[3:], h), _cross3(h, linear) + turning])


def _cross(x: Array, y: Array) -> Array:
    """Change (6, ...) of motions y that move with velocity x."""
    return np.concatenate([_cross3(x[3:], y[:3]) + _cross3(x[:3], y[3:]), _cross3(x[3:], y[3:])])


def _dual(x: Array, f: Array) -> Array:
    """Change (6, ...) of forces f that move with velocity x."""
    return np.concatenate([_cross3(x[3:], f[:3]), _cross3(x[3:], f[3:]) + _cross3(x[:3], f[:3])])


def _cross3(x: Array, y: Array) -> Array:
    return np.array([x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]])
