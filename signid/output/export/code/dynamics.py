"""Dynamics of a model as expressions: its rigid bodies by recursive Newton-Euler, and the equations of its laws."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ....effects.naming import law_name
from ....errors import RobotError
from ....model import Model, torque_model
from ....types import Array, Law
from ..formats import equation_numbers, writable
from .graph import BINARY, UNARY, Graph, Scalar, binary, unary, where

MAX_ROUNDING = 2e-11  # [1] deviation of rotations from 0, 1 and -1 that is rounding: pi / 2 is written 1.57079632679
Expressions = Any  # array of objects: Scalar or float
OPERATIONS: dict[type[ast.AST], Any] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.Gt: operator.gt,
    ast.Lt: operator.lt,
}
SIGN_FUNCTION = "sign of velocity"  # function in the place of sign(v)


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
    shown, rounding = body.inertia - beta * across, 4e-16 * (np.abs(body.inertia) + np.abs(beta * across))
    shown = np.where(np.abs(shown) <= rounding, 0.0, shown)
    left = replace(body, mass=0.0, moment=body.moment - along * u, inertia=shown)
    first = r @ (along * u)
    cross_p, cross_h = pin.skew(p), pin.skew(first)
    inertia = beta * r @ across @ r.T - cross_p @ cross_h - cross_h @ cross_p - mass * cross_p @ cross_p
    return left, (mass, first + mass * p, inertia)


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


def law_expressions(
    graph: Graph, model: Model, motion: Mapping[str, Expressions], tracking: tuple[Expressions, Scalar] | None = None
) -> Expressions:
    """Torque (n,) of the laws that can be written.

    motion: "q", "v", "a" and "load" (n,) [rad or m, and their derivatives; N.m or N]. tracking: desired velocity (n,)
    [rad/s or m/s] and inverse width of smoothing, or None. With them, a law f(v, sign(v)) is f(v, 0) + f(v_desired, s)
    - f(v_desired, 0), s = tanh(v_desired / width): the part that jumps with the sign of v depends on v_desired alone.
    """

    def no_sign(_: Scalar) -> Scalar:
        return graph.constant(0.0)

    total = np.array([graph.constant(0.0)] * len(model.robot.joints))
    for law, here, signals in _acting(graph, model, motion):
        if tracking is None:
            torque = _evaluate(graph, law, signals)
        else:
            desired = {**signals, "v": tracking[0][here]}
            smooth = _evaluate(graph, law, desired, lambda x: unary("tanh", x * tracking[1]))
            jump = smooth - _evaluate(graph, law, desired, no_sign)
            torque = _evaluate(graph, law, signals, no_sign) + jump
        total[here] = total[here] + torque
    return total


def directed_laws(
    graph: Graph, model: Model, motion: Mapping[str, Expressions], slow: Expressions
) -> tuple[Expressions, Expressions]:
    """Torque (n,) of the laws, the sign of v proportional to it below `slow`, and size (n,) of friction that reverses.

    motion: "q", "v", "a" and "load" (n,), as in `law_expressions`; slow: (n,) [rad/s or m/s].
    """

    def direction(width: Scalar, x: Scalar) -> Scalar:  # the sign, proportional to the velocity below a width
        return _clip(x / width, graph.constant(-1.0), graph.constant(1.0))

    def side(x: Scalar) -> Scalar:  # a sign that is never 0
        return where(graph.constant(0.0) > x, graph.constant(-1.0), graph.constant(1.0))

    total, reversing = np.full((2, len(slow)), graph.constant(0.0))
    for law, here, signals in _acting(graph, model, motion):
        joints = list(law.joints)
        torque = _evaluate(graph, law, signals, partial(direction, sum(slow[joints])))
        total[here] = total[here] + torque
        if law.effect.reverses:
            fast = np.array([side(motion["v"][j]) * binary("maximum", abs(motion["v"][j]), slow[j]) for j in joints])
            torque = _evaluate(graph, law, {**signals, "v": fast[0] if len(joints) == 1 else fast}, side)
            reversing[here] = reversing[here] + abs(torque)
    return total, reversing


def _acting(
    graph: Graph, model: Model, motion: Mapping[str, Expressions]
) -> Iterator[tuple[Law, int | list[int], dict[str, Expressions]]]:
    """Laws that can be written, their joints (one alone: its number), and the motion there."""
    for law in filter(writable, torque_model(model).laws):
        graph.section = law_name(law, model.robot)
        here = law.joints[0] if len(law.joints) == 1 else list(law.joints)
        yield law, here, {key: x[here] for key, x in motion.items()}


def _evaluate(
    graph: Graph, law: Law, signals: Mapping[str, Any], sign: Callable[[Scalar], Scalar] | None = None
) -> Any:
    """Torque of a law; sign: in the place of the sign of a velocity and of a tanh that stands for one."""
    numbers, variable = equation_numbers(law)
    if variable:
        numbers["variable"] = signals[variable]
    functions: dict[str, Any] = {name: _lifted(graph, partial(unary, name), 1) for name in UNARY}
    functions |= {name: _lifted(graph, partial(binary, name), 2) for name in BINARY}
    functions |= {"where": _lifted(graph, where, 3), "clip": _lifted(graph, _clip, 3), "pi": np.pi}
    functions |= {"interp": partial(_interpolate, graph), "sum": sum}
    if sign is not None:
        functions[SIGN_FUNCTION] = np.frompyfunc(sign, 1, 1)
    return _value(ast.parse(law.effect.equation, mode="eval").body, {**functions, **signals, **numbers})


def _value(node: ast.expr, names: Mapping[str, Any]) -> Any:
    """Value of an equation: numbers, names, calls, arithmetic, comparisons by > and <, and reversal by [::-1]."""
    match node:
        case ast.Constant():
            return node.value
        case ast.Name():
            return names[node.id]
        case ast.UnaryOp(op=ast.USub()):
            return -_value(node.operand, names)
        case ast.BinOp():
            return OPERATIONS[type(node.op)](_value(node.left, names), _value(node.right, names))
        case ast.Compare(ops=[ast.Gt() | ast.Lt()]):
            return OPERATIONS[type(node.ops[0])](_value(node.left, names), _value(node.comparators[0], names))
        case ast.Call() if SIGN_FUNCTION in names and (velocity := _signed_velocity(node)):
            return names[SIGN_FUNCTION](_value(velocity, names))
        case ast.Call():
            return _value(node.func, names)(*(_value(x, names) for x in node.args))
        case ast.Subscript():
            return _value(node.value, names)[::-1]
    raise ValueError(f"an equation with {ast.dump(node)} cannot be written as code")


def _signed_velocity(call: ast.Call) -> ast.expr | None:
    """Velocity (or sum of two) x in sign(x), or in tanh(x / scale), which stands for it; None for other calls."""
    match call:
        case (
            ast.Call(func=ast.Name(id="sign"), args=[x])
            | ast.Call(func=ast.Name(id="tanh"), args=[ast.BinOp(left=x, op=ast.Div())])
        ):
            names = {part.id for part in ast.walk(x) if isinstance(part, ast.Name)}
            return x if "v" in names and names <= {"v", "sum"} else None
    return None


def _lifted(graph: Graph, function: Callable[..., Scalar], operands: int) -> Any:
    """A function of nodes as one of arrays of nodes and numbers."""
    return np.frompyfunc(lambda *arguments: function(*map(graph.scalar, arguments)), operands, 1)


def _interpolate(graph: Graph, x: Scalar, knots: list[float], values: list[float]) -> Scalar:
    """Piecewise linear function, constant beyond its ends, as a sum of clipped ramps."""
    total = graph.constant(values[0])
    for low, high, here, there in zip(knots[:-1], knots[1:], values[:-1], values[1:], strict=True):
        total = total + (there - here) * _clip((x - low) / (high - low), graph.constant(0.0), graph.constant(1.0))
    return total


def _clip(x: Scalar, low: Scalar, high: Scalar) -> Scalar:
    return binary("minimum", binary("maximum", x, low), high)
