"""Rigid bodies of a model as expressions: recursive Newton-Euler over the regrouped inertial parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ....errors import RobotError
from ....model import Model
from ....types import Array
from .graph import Graph, Scalar, unary

MAX_ROUNDING = 2e-11  # [1] deviation of rotations from 0, 1 and -1 that is rounding: pi / 2 is written 1.57079632679
Expressions = Any  # array of objects: Scalar or float


@dataclass(frozen=True)
class Body:
    """One body and its joint: placement in the frame of the parent, axis in its own frame, inertial parameters."""

    name: str  # of its joint and its link, for comments
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
    bodies = [_body(whole, k, link) for k, link in enumerate(model.robot.links, 1)]
    for k in reversed(range(len(bodies))):
        bodies[k], moved = _regrouped(bodies[k])
        parent = bodies[k].parent
        if parent >= 0:
            p = bodies[parent]
            bodies[parent] = replace(
                p, mass=p.mass + moved[0], moment=p.moment + moved[1], inertia=p.inertia + moved[2]
            )
    rest = np.asarray(model.robot.rest)
    return Bodies(tuple(bodies), whole.gravity.linear.copy(), whole.armature.copy(), model.robot.drive, rest)


def _body(whole: pin.Model, k: int, link: str) -> Body:
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
    axis = exact(subspace[:3] if prismatic else subspace[3:])
    body = whole.inertias[k]
    rotation = exact(placement.rotation @ moved.rotation)
    x = body.toDynamicParameters()
    inertia = np.array([[x[4], x[5], x[7]], [x[5], x[6], x[8]], [x[7], x[8], x[9]]])
    name, position = f"{whole.names[k]} ({link})", placement.translation.copy()
    return Body(name, whole.parents[k] - 1, rotation, position, axis, prismatic, x[0], x[1:4], inertia)


def exact(x: Array) -> Array:
    """Entries of rotations; 0, 1 and -1 where rounding alone makes them differ from that. x: (...) [1]."""
    near = np.round(x)
    return np.where(np.abs(x - near) < MAX_ROUNDING, near, x)


def _regrouped(body: Body) -> tuple[Body, tuple[float, Array, Array]]:
    """The body without what its joint cannot show, and that part in the frame of the parent.

    Source: Khalil, Dombre, Modeling, Identification and Control of Robots, 2002, section 9.4: a revolute joint shows
    neither the mass, nor the first moment along its axis, nor an inertia about the axes across; a prismatic joint shows
    no inertia about any axis.
    """
    u, r, p = body.axis, body.rotation, body.position
    if body.prismatic:
        return replace(body, inertia=np.zeros((3, 3))), (0.0, np.zeros(3), r @ body.inertia @ r.T)
    across = np.eye(3) - np.outer(u, u)
    side = across[:, int(np.argmin(np.abs(u)))]
    side = side / np.linalg.norm(side)
    beta = float(side @ body.inertia @ side)
    mass, along = body.mass, float(u @ body.moment)
    left = replace(body, mass=0.0, moment=body.moment - along * u, inertia=_exact_sum(body.inertia, -beta * across))
    first = r @ (along * u)
    cross_p, cross_h = pin.skew(p), pin.skew(first)
    inertia = beta * r @ across @ r.T - cross_p @ cross_h - cross_h @ cross_p - mass * cross_p @ cross_p
    return left, (mass, first + mass * p, inertia)


def _exact_sum(a: Array, b: Array) -> Array:
    """A + b, 0 where only rounding errors remain."""
    total = a + b
    return np.where(np.abs(total) <= 4e-16 * (np.abs(a) + np.abs(b)), 0.0, total)


class State(NamedTuple):
    """Motion of a body in its own frame, and its placement in the frame of its parent."""

    w: Expressions  # (3,) angular velocity [rad/s]
    alpha: Expressions  # (3,) angular acceleration [rad/s2]
    acc: Expressions  # (3,) acceleration of the origin, minus gravity [m/s2]
    turn: Expressions  # (3, 3) [1]
    offset: Expressions  # (3,) [m]


def rigid_torque(graph: Graph, tree: Bodies, q: Expressions, v: Expressions, a: Expressions) -> Expressions:
    """Torque (n,) of the rigid bodies, by the recursive Newton-Euler algorithm.

    q, v, a: (n,) expressions [rad or m, and their derivatives]. Source: Featherstone, Rigid Body Dynamics Algorithms,
    2008, section 5.3.
    """
    states = motions(graph, tree, q, v, a)
    forces = []
    for body, state in zip(tree.bodies, states, strict=True):
        graph.section = f"{body.name}: force and moment"
        forces.append(wrench(body.mass, body.moment, body.inertia, state))
    return joint_torque(graph, tree, states, forces)


def motions(graph: Graph, tree: Bodies, q: Expressions, v: Expressions, a: Expressions) -> list[State]:
    """State of each body, from the base outwards."""
    angles, speeds, rates = tree.drive @ q + tree.rest, tree.drive @ v, tree.drive @ a
    none = np.array([graph.constant(0.0)] * 3)
    base = State(none, none, none - tree.gravity, np.eye(3), none)
    states: list[State] = []
    for k, body in enumerate(tree.bodies):
        graph.section = f"{body.name}: motion"
        turn, offset = placement(graph, body, graph.scalar(angles[k]))
        w0, alpha0, acc0, *_ = states[body.parent] if body.parent >= 0 else base
        carried = acc0 + cross(alpha0, offset) + cross(w0, cross(w0, offset))
        w, alpha, acc = turn.T @ w0, turn.T @ alpha0, turn.T @ carried
        along = body.axis * speeds[k]
        if body.prismatic:
            acc = acc + 2.0 * cross(w, along) + body.axis * rates[k]
        else:
            alpha = alpha + cross(w, along) + body.axis * rates[k]
            w = w + along
        states.append(State(w, alpha, acc, turn, offset))
    return states


def joint_torque(
    graph: Graph, tree: Bodies, states: list[State], forces: list[tuple[Expressions, Expressions]]
) -> Expressions:
    """Torque (n,) that balances a force and a moment about its origin on each body, from the tips inwards."""
    forces = list(forces)
    torque = np.array([graph.constant(0.0)] * len(tree.bodies))
    for k in reversed(range(len(tree.bodies))):
        body, (force, moment) = tree.bodies[k], forces[k]
        graph.section = f"{body.name}: torque"
        torque[k] = body.axis @ (force if body.prismatic else moment)
        if body.parent >= 0:
            above = forces[body.parent]
            carried = carried_wrench(states[k].turn, states[k].offset, force, moment)
            forces[body.parent] = above[0] + carried[0], above[1] + carried[1]
    return np.array([graph.scalar(x) for x in tree.drive.T @ torque])


def carried_wrench(
    turn: Expressions, offset: Expressions, force: Expressions, moment: Expressions
) -> tuple[Expressions, Expressions]:
    """A force and its moment about the origin of a frame, in the axes and about the origin of the parent frame."""
    carried = turn @ force
    return carried, turn @ moment + cross(offset, carried)


def rotor_torque(tree: Bodies, a: Expressions) -> Expressions:
    """Torque (n,) of the rotors at accelerations a (n,) [rad/s2 or m/s2]."""
    return tree.drive.T @ (tree.rotors * (tree.drive @ a))


def placement(graph: Graph, body: Body, angle: Scalar) -> tuple[Expressions, Expressions]:
    """Rotation (3, 3) and position (3,) of a body in the frame of its parent."""
    if body.prismatic:
        still: Expressions = body.rotation + graph.constant(0.0)
        return still, body.position + body.rotation @ body.axis * angle
    s, c, u = unary("sin", angle), unary("cos", angle), body.axis
    fixed = np.outer(u, u)
    turn: Expressions = fixed + exact(np.eye(3) - fixed) * c + pin.skew(u) * s
    return body.rotation.astype(object) @ turn, body.position + graph.constant(0.0)


def wrench(mass: Any, moment: Any, inertia: Any, state: State) -> tuple[Expressions, Expressions]:
    """Force and moment about its origin that move a body; mass, first moment (3,), inertia (3, 3): numbers or nodes."""
    w, alpha, acc, *_ = state
    force = acc * mass + cross(alpha, moment) + cross(w, cross(w, moment))
    spin = inertia @ w
    return force, cross(moment, acc) + inertia @ alpha + cross(w, spin)


def cross(a: Expressions, b: Expressions) -> Expressions:
    """Cross product (3,) of expressions or numbers."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
