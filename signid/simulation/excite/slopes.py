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

    weights: (N, m_j) [any units] of each joint's rows, constant. Slopes of laws, each of which acts at one joint only,
    are differences; those of bodies are exact, from the inertial parameters that the weights would be.

    Source: derivatives of the joints' axes as in Carpentier, Mansard, Robotics: Science and Systems, 2018.
    """
    rigid = 10 * len(motion.robot.links)
    split = [int(np.searchsorted(columns, rigid)) for columns in wanted]
    further = [columns[k:] - rigid for columns, k in zip(wanted, split, strict=True)]
    shifts = np.pad(np.diag(LAW_STEPS), ((0, 0), (1, 0)))  # (3, 4): none, then one of q, v and a
    near = np.array([motion.q, motion.v, motion.a])[:, None] + shifts[..., None, None]
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

    Motions (6, ..., N) are linear and angular velocity, forces (6, ..., N) moment and force, both about the world's
    origin and along its axes unless said otherwise: then one cross product, and one change of axes, serves both.
    """
    model, (v, a) = motion.robot.model, motion.rates
    joints = [i for i in range(1, model.njoints) for _ in range(model.joints[i].nv)]
    above = np.array([[joints[k] in path for k in moving] for path in map(set, model.supports)])  # rows move a body
    body, row = np.nonzero(above[1:] & weights.any(axis=(1, 3)))
    axes, places = np.empty((len(motion), 6, len(moving))), np.empty((len(motion), model.njoints, 4, 4))
    data = model.createData()
    for i, q in enumerate(motion.configuration):
        axes[i] = np.reshape(pin.computeJointJacobians(model, data, q), (6, -1))[:, moving]
        places[i] = [place.homogeneous for place in data.oMi]
    s, place = np.ascontiguousarray(axes.transpose(1, 2, 0)), places[:, body + 1].transpose(2, 3, 1, 0)
    turn, shift = np.ascontiguousarray(place[:3, :3]), place[:3, 3, :, None].swapaxes(1, 2)
    upto = above[[joints[k] for k in moving]]  # (m, m) rows before each, with itself
    own = s * v[:, moving].T
    velocity = upto.astype(float) @ own
    change = s * a[:, moving].T + _cross(velocity, own)
    acceleration = upto.astype(float) @ change - np.append(model.gravity.linear, np.zeros(3))[:, None, None]

    last = np.array([max(np.flatnonzero(rows), default=0) for rows in above])[body + 1]
    x = np.array([s[:, row], velocity[:, last], acceleration[:, last]]).swapaxes(0, 1)  # in the body's axes from here
    parts = x[:3] + _cross3(x[3:], shift), x[3:]
    x = np.concatenate([np.einsum("ba...,bc...->ac...", turn, part) for part in parts])
    x = np.concatenate([x, _cross(x[:, 0], x[:, 1])[:, None]], axis=1)
    mass, first, (xx, xy, yy, xz, yz, zz) = np.split(weights[body, :, row].swapaxes(0, 1), [1, 4])
    turning = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    moment = _cross3(first[:, None], x[:3]) + np.einsum("ab...,bc...->ac...", turning, x[3:])
    momenta = np.concatenate([moment, mass[:, None] * x[:3] + _cross3(x[3:], first[:, None])])
    axial, momentum, inertial, turned = momenta.swapaxes(0, 1)
    axis, speed = x[:, 0], x[:, 1]
    rest = turned - _cross(axis, momentum) + _cross(speed, axial)
    forces = np.array([axial, rest, _cross(axis, inertial + _cross(speed, momentum))]).swapaxes(0, 1)
    moment, force = (np.einsum("ab...,bc...->ac...", turn, part) for part in (forces[:3], forces[3:]))
    forces = np.concatenate([moment + _cross3(shift, force), force])

    below = above[body + 1].T  # (m, pairs of a body and a row)
    ahead = below & upto[:, row] & (row != np.arange(len(moving))[:, None])
    carried = [part.astype(float) @ forces[:, k] for k, part in enumerate((below, below, ahead))]
    velocity, acceleration = velocity - own, acceleration - change  # of the body before
    drag = _cross(velocity, carried[0])
    by_place = -carried[2] - _cross(acceleration, carried[0]) - _cross(velocity, carried[1] - drag)
    slopes = np.array([by_place, carried[1] - 2 * drag, carried[0]])
    return np.asarray(np.einsum("kcmn,cmn->knm", slopes, np.roll(s, 3, axis=0)))


def _cross(x: Array, y: Array) -> Array:
    """Rate of change (6, ...) of y, a motion or a force (6, ...), that is carried along by a motion x (6, ...)."""
    return np.concatenate([_cross3(x[3:], y[:3]) + _cross3(x[:3], y[3:]), _cross3(x[3:], y[3:])])


def _cross3(x: Array, y: Array) -> Array:
    return np.array([x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]])
