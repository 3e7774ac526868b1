"""Inverse dynamics of robots whose joints have one axis each, along many rows in compiled code.

Pinocchio from Python takes two to four times as long (3 to 7 joints, 200 rows), and a search needs thousands of loads.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numba import njit

from ...frozen import Frozen
from ...types import Array, Mask, Robot


class Bodies(NamedTuple):
    """Joints of a robot in Pinocchio's order, m of them, with the bodies that they carry."""

    parent: Array  # (m,) [1] number of the parent joint, -1 for the base
    rotation: Array  # (m, 3, 3) [1] from the frame of a joint at zero to its parent's
    place: Array  # (m, 3) [m] in the frame of the parent
    axis: Array  # (m, 3) [1] in the frame of the joint
    slides: Mask  # (m,)
    mass: Array  # (m,) [kg]
    centre: Array  # (m, 3) [m]
    inertia: Array  # (m, 3, 3) [kg.m2] about the centre
    gravity: Array  # (3,) [m/s2]


@dataclass(frozen=True, eq=False)
class Chain(Frozen):
    """Bodies moved by n coordinates."""

    bodies: Bodies
    drive: Array  # (m, n) speed of each joint per coordinate [1]
    rest: Array  # (m,) [rad or m] position of each joint at coordinates of zero

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """Inverse dynamics (N, n) [N.m or N].

        q: (N, n) [rad or m]; v: (N, n) [rad/s or m/s]; a: (N, n) [rad/s2 or m/s2].
        """
        turn = self.drive.T
        x = (np.ascontiguousarray(y) for y in (q @ turn + self.rest, v @ turn, a @ turn))
        return np.asarray(_torque(*x, self.bodies) @ self.drive)


class _Motion(NamedTuple):
    """Motion of m joints at one instant, in their own frames."""

    turn: Array  # (m, 3, 3) [1] to the frame of the parent
    at: Array  # (m, 3) [m] in the frame of the parent
    w: Array  # (m, 3) [rad/s]
    alpha: Array  # (m, 3) [rad/s2]
    acc: Array  # (m, 3) [m/s2]


def chain_of(robot: Robot) -> Chain | None:
    """Chain of a robot; None if a joint has several axes."""
    model = robot.model
    joints = list(model.joints)[1:]
    if any(joint.nv != 1 for joint in joints) or [joint.idx_v for joint in joints] != list(range(model.nv)):
        return None
    data, at = model.createData(), pin.neutral(model)
    pin.computeJointJacobians(model, data, at)
    every = (np.reshape(pin.getJointJacobian(model, data, i + 1, pin.LOCAL), (6, -1)) for i in range(model.nv))
    own = [jacobian[:, i] for i, jacobian in enumerate(every)]
    slides = np.array([bool(np.linalg.norm(column[3:]) < 0.5) for column in own])
    axis = np.array([column[:3] if slide else column[3:] for column, slide in zip(own, slides, strict=True)])
    places, bodies = list(model.jointPlacements)[1:], list(model.inertias)[1:]
    carried = Bodies(
        np.array([parent - 1 for parent in list(model.parents)[1:]]),
        np.array([place.rotation for place in places]),
        np.array([place.translation for place in places]),
        axis,
        slides,
        np.array([body.mass for body in bodies]),
        np.array([body.lever for body in bodies]),
        np.array([body.inertia for body in bodies]),
        np.array(model.gravity.linear),
    )
    return Chain(carried, np.asarray(robot.drive, float), np.asarray(robot.rest, float) * np.ones(model.nv))


def _compiled(function):  # type: ignore[no-untyped-def]
    return njit(cache=True, error_model="numpy")(function)


@_compiled
def _get(x, i):  # type: ignore[no-untyped-def]
    return x[i, 0], x[i, 1], x[i, 2]


@_compiled
def _put(x, i, a):  # type: ignore[no-untyped-def]
    x[i, 0], x[i, 1], x[i, 2] = a


@_compiled
def _cross(a, b):  # type: ignore[no-untyped-def]
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@_compiled
def _sum(a, b, s):  # type: ignore[no-untyped-def]
    """Vector a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@_compiled
def _out(m, i, x):  # type: ignore[no-untyped-def]
    """Matrix i of m, times x."""
    return (
        m[i, 0, 0] * x[0] + m[i, 0, 1] * x[1] + m[i, 0, 2] * x[2],
        m[i, 1, 0] * x[0] + m[i, 1, 1] * x[1] + m[i, 1, 2] * x[2],
        m[i, 2, 0] * x[0] + m[i, 2, 1] * x[1] + m[i, 2, 2] * x[2],
    )


@_compiled
def _in(m, i, x):  # type: ignore[no-untyped-def]
    """Transposed matrix i of m, times x."""
    return (
        m[i, 0, 0] * x[0] + m[i, 1, 0] * x[1] + m[i, 2, 0] * x[2],
        m[i, 0, 1] * x[0] + m[i, 1, 1] * x[1] + m[i, 2, 1] * x[2],
        m[i, 0, 2] * x[0] + m[i, 1, 2] * x[1] + m[i, 2, 2] * x[2],
    )


@_compiled
def _about(axis, angle, x):  # type: ignore[no-untyped-def]
    """Vector x, turned by an angle about an axis."""
    s, c = np.sin(angle), np.cos(angle)
    along = (1 - c) * (axis[0] * x[0] + axis[1] * x[1] + axis[2] * x[2])
    return _sum(_sum((c * x[0], c * x[1], c * x[2]), _cross(axis, x), s), axis, along)


@_compiled
def _move(bodies, i, q, v, a, motion):  # type: ignore[no-untyped-def]
    """Place and motion of joint i from those of its parent; gravity is an acceleration of the base."""
    rotation, slides, gravity = bodies.rotation, bodies.slides, bodies.gravity
    turn, at, w, alpha, acc = motion
    p, own, here = bodies.parent[i], _get(bodies.axis, i), _get(bodies.place, i)
    if slides[i]:
        here = _sum(here, _out(rotation, i, own), q)
    for k in range(3):  # rows of rotation after the turn: each is turned back
        x = rotation[i, k, 0], rotation[i, k, 1], rotation[i, k, 2]
        turn[i, k, 0], turn[i, k, 1], turn[i, k, 2] = x if slides[i] else _about(own, -q, x)
    _put(at, i, here)
    spin, rise, fall = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (-gravity[0], -gravity[1], -gravity[2])
    if p >= 0:
        spin, rise = _get(w, p), _get(alpha, p)
        fall = _sum(_sum(_get(acc, p), _cross(rise, here), 1.0), _cross(spin, _cross(spin, here)), 1.0)
    spin, rise, fall = _in(turn, i, spin), _in(turn, i, rise), _in(turn, i, fall)
    if slides[i]:
        fall = _sum(_sum(fall, own, a), _cross(spin, own), 2 * v)
    else:
        rise = _sum(_sum(rise, own, a), _cross(spin, own), v)
        spin = _sum(spin, own, v)
    _put(w, i, spin)
    _put(alpha, i, rise)
    _put(acc, i, fall)


@_compiled
def _torque(q, v, a, bodies):  # type: ignore[no-untyped-def]
    """Recursive Newton-Euler algorithm (Luh, Walker, Paul 1980), all in the frames of the joints."""
    rows, m = q.shape
    out = np.empty((rows, m))
    turn, at = np.empty((m, 3, 3)), np.empty((m, 3))
    w, alpha, acc, f, n = np.zeros((5, m, 3))
    motion = _Motion(turn, at, w, alpha, acc)
    parent, _, _, axis, slides, mass, centre, inertia, _ = bodies
    for t in range(rows):
        for i in range(m):
            _move(bodies, i, q[t, i], v[t, i], a[t, i], motion)
            c, spin, rise = _get(centre, i), _get(w, i), _get(alpha, i)
            push = _sum(_sum(_get(acc, i), _cross(rise, c), 1.0), _cross(spin, _cross(spin, c)), 1.0)
            push = (mass[i] * push[0], mass[i] * push[1], mass[i] * push[2])
            twist = _sum(_out(inertia, i, rise), _cross(spin, _out(inertia, i, spin)), 1.0)
            _put(f, i, push)
            _put(n, i, _sum(twist, _cross(c, push), 1.0))
        for i in range(m - 1, -1, -1):
            own, p = (f if slides[i] else n), parent[i]
            out[t, i] = axis[i, 0] * own[i, 0] + axis[i, 1] * own[i, 1] + axis[i, 2] * own[i, 2]
            if p >= 0:
                push = _out(turn, i, _get(f, i))
                twist = _sum(_out(turn, i, _get(n, i)), _cross(_get(at, i), push), 1.0)
                _put(f, p, _sum(_get(f, p), push, 1.0))
                _put(n, p, _sum(_get(n, p), twist, 1.0))
    return out
