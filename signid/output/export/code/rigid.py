"""Rigid bodies of a model as expressions: recursive Newton-Euler over the regrouped inertial parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from ....errors import RobotError
from ....model import Model
from ....types import Array
from .graph import Graph, Scalar, unary

ROUNDING = 2e-11  # [1] deviation of rotations from 0, 1 and -1 that is rounding: pi / 2 is written 1.57079632679
Expressions = Any  # array of objects: Scalar or float


@dataclass(frozen=True)
class Body:
    """One body and its joint: placement in the frame of the parent, axis in its own frame, inertial parameters."""

    parent: int  # -1: the base
    rotation: Array  # (3, 3) [1]
    position: Array  # (3,) [m]
    axis: Array  # (3,) [1]
    prismatic: bool
    mass: float  # [kg], regrouped
    moment: Array  # (3,) first moment [kg.m], regrouped
    inertia: Array  # (3, 3) about the frame of the joint [kg.m2], regrouped


@dataclass(frozen=True)
class Bodies:
    """Bodies of a model, each after its parent, with gravity and rotor inertias."""

    bodies: tuple[Body, ...]
    gravity: Array  # (3,) [m/s2]
    rotors: Array  # (nv,) [kg.m2 or kg]
    drive: Array  # (nv, n) [1]
    rest: Array  # (nv,) [rad or m]


def tree_of(model: Model) -> Bodies:
    """Bodies of a model, with inertial parameters regrouped towards the base.

    Raises:
        RobotError: a joint is neither revolute nor prismatic.
    """
    whole = model.bodies()
    bodies = [_body(whole, k) for k in range(1, whole.njoints)]
    for k in reversed(range(len(bodies))):
        bodies[k], moved = _regrouped(bodies[k])
        parent = bodies[k].parent
        if parent >= 0:
            p = bodies[parent]
            added = (p.mass + moved[0], p.moment + moved[1], p.inertia + moved[2])
            bodies[parent] = Body(p.parent, p.rotation, p.position, p.axis, p.prismatic, *added)
    rest = np.asarray(model.robot.rest)
    return Bodies(tuple(bodies), whole.gravity.linear.copy(), whole.armature.copy(), model.robot.drive, rest)


def _body(whole: pin.Model, k: int) -> Body:
    joint, placement = whole.joints[k], whole.jointPlacements[k]
    if joint.nv != 1:
        raise RobotError(
            f"joint {whole.names[k]} of {whole.name} has {joint.nv} degrees of freedom, but code is written for "
            f"revolute and prismatic joints only; fix the base, or hold that joint (--lock)"
        )
    data = joint.createData()
    joint.calc(data, pin.neutral(whole))
    moved, subspace = data.M.copy(), np.array(data.S).ravel()
    prismatic = bool(np.abs(subspace[:3]).max() > np.abs(subspace[3:]).max())
    axis = _exact(subspace[:3] if prismatic else subspace[3:])
    body = whole.inertias[k]
    rotation = _exact(placement.rotation @ moved.rotation)
    x = body.toDynamicParameters()
    inertia = np.array([[x[4], x[5], x[7]], [x[5], x[6], x[8]], [x[7], x[8], x[9]]])
    return Body(whole.parents[k] - 1, rotation, placement.translation.copy(), axis, prismatic, x[0], x[1:4], inertia)


def _exact(x: Array) -> Array:
    near = np.round(x)
    return np.where(np.abs(x - near) < ROUNDING, near, x)


def _regrouped(body: Body) -> tuple[Body, tuple[float, Array, Array]]:
    """The body without what its joint cannot show, and that part in the frame of the parent.

    Source: Khalil, Dombre, Modeling, Identification and Control of Robots, 2002, section 9.4: a revolute joint shows
    neither the mass, nor the first moment along its axis, nor an inertia about the axes across; a prismatic joint shows
    no inertia about any axis.
    """
    u, r, p = body.axis, body.rotation, body.position
    if body.prismatic:
        rest = Body(body.parent, r, p, u, True, body.mass, body.moment, np.zeros((3, 3)))
        return rest, (0.0, np.zeros(3), r @ body.inertia @ r.T)
    across = np.eye(3) - np.outer(u, u)
    side = across[:, int(np.argmin(np.abs(u)))]
    side = side / np.linalg.norm(side)
    beta = float(side @ body.inertia @ side)
    mass, along = body.mass, float(u @ body.moment)
    left = Body(body.parent, r, p, u, False, 0.0, body.moment - along * u, _exact_sum(body.inertia, -beta * across))
    first = r @ (along * u)
    cross_p, cross_h = pin.skew(p), pin.skew(first)
    inertia = beta * r @ across @ r.T - cross_p @ cross_h - cross_h @ cross_p - mass * cross_p @ cross_p
    return left, (mass, first + mass * p, inertia)


def _exact_sum(a: Array, b: Array) -> Array:
    """A + b, 0 where only rounding errors remain."""
    total = a + b
    return np.where(np.abs(total) <= 4e-16 * (np.abs(a) + np.abs(b)), 0.0, total)


def rigid_torque(
    graph: Graph,
    tree: Bodies,
    q: Expressions,
    v: Expressions,
    a: Expressions,
    *,
    gravity: bool = True,
) -> Expressions:
    """Torque (n,) of the rigid bodies, by the recursive Newton-Euler algorithm.

    q, v, a: (n,) expressions [rad or m, and their derivatives]. Source: Featherstone, Rigid Body Dynamics Algorithms,
    2008, section 5.3.
    """
    zero = graph.constant(0.0)
    angles, speeds, rates = tree.drive @ q + tree.rest, tree.drive @ v, tree.drive @ a
    none = np.array([zero] * 3)
    lift = none - tree.gravity if gravity else none
    states: list[tuple[Expressions, ...]] = []
    for k, body in enumerate(tree.bodies):
        turn, offset = _joint(graph, body, graph.scalar(angles[k]))
        w0, alpha0, acc0 = states[body.parent][:3] if body.parent >= 0 else (none, none, lift)
        carried = acc0 + cross(alpha0, offset) + cross(w0, cross(w0, offset))
        w, alpha, acc = turn.T @ w0, turn.T @ alpha0, turn.T @ carried
        along = body.axis * speeds[k]
        if body.prismatic:
            acc = acc + 2.0 * cross(w, along) + body.axis * rates[k]
        else:
            alpha = alpha + cross(w, along) + body.axis * rates[k]
            w = w + along
        states.append((w, alpha, acc, turn, offset))
    forces = [_wrench(body, *state[:3]) for body, state in zip(tree.bodies, states, strict=True)]
    torque = np.array([zero] * len(tree.bodies))
    for k in reversed(range(len(tree.bodies))):
        body, (force, moment) = tree.bodies[k], forces[k]
        torque[k] = body.axis @ (force if body.prismatic else moment)
        if body.parent >= 0:
            turn, offset = states[k][3:]
            carried = turn @ force
            above = forces[body.parent]
            forces[body.parent] = above[0] + carried, above[1] + turn @ moment + cross(offset, carried)
    return np.array([graph.scalar(x) for x in tree.drive.T @ torque])


def rotor_torque(tree: Bodies, a: Expressions) -> Expressions:
    """Torque (n,) of the rotors at accelerations a (n,) [rad/s2 or m/s2]."""
    return tree.drive.T @ (tree.rotors * (tree.drive @ a))


def _joint(graph: Graph, body: Body, angle: Scalar) -> tuple[Expressions, Expressions]:
    """Rotation (3, 3) and position (3,) of a body in the frame of its parent."""
    if body.prismatic:
        still: Expressions = body.rotation + graph.constant(0.0)
        return still, body.position + body.rotation @ body.axis * angle
    s, c, u = unary("sin", angle), unary("cos", angle), body.axis
    fixed = np.outer(u, u)
    turn: Expressions = fixed + _exact(np.eye(3) - fixed) * c + pin.skew(u) * s
    return body.rotation.astype(object) @ turn, body.position + graph.constant(0.0)


def _wrench(body: Body, w: Expressions, alpha: Expressions, acc: Expressions) -> tuple[Expressions, Expressions]:
    force = body.mass * acc + cross(alpha, body.moment) + cross(w, cross(w, body.moment))
    spin = body.inertia @ w
    return force, cross(body.moment, acc) + body.inertia @ alpha + cross(w, spin)


def cross(a: Expressions, b: Expressions) -> Expressions:
    """Cross product (3,) of expressions or numbers."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
