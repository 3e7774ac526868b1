"""Functions of a model as expressions: inverse and forward dynamics, gravity, laws, mass matrix, Jacobian, payload."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ....errors import RobotError, shorten
from ....model import Model, torque_model
from ....robot import configuration
from ....robot.dynamics import mass_matrices, own_body
from ....types import Array
from .dynamics import (
    Bodies,
    Body,
    Expressions,
    State,
    carried_wrench,
    cross,
    exact,
    joint_torque,
    law_expressions,
    motions,
    placement,
    rigid_torque,
    rotor_torque,
    tree_of,
    wrench,
)
from .graph import Graph, Scalar, binary, unary

MASS_MEANING = (
    "mass matrix by rows, of the bodies, the armature and couplings of joints: mass_matrix(q) a + "
    "inverse_dynamics(q, v, 0) = inverse_dynamics(q, v, a) where no law depends on load or is a curve over acceleration"
)
LAWS_MEANING = (
    "torque of the laws alone: armature, friction, springs, offsets; mass_matrix holds the armature, too: "
    "inverse_dynamics(q, v, a) is mass_matrix(q) a + Coriolis torque + gravity(q) + laws(q, v, 0)"
)
TRACKING = (
    "inverse_dynamics, but with sign(v) of every law as tanh(v_desired / width), so that measured noise at rest does "
    "not switch friction; levels that vary with speed are those at v_desired; laws that are continuous in the "
    "velocity, such as viscous friction, act at v; width [rad/s or m/s]: 0.76 of dry friction at v_desired = width, "
    "0.995 at 3 width; values below 1e-9 act as 1e-9"
)
NONLINEAR_MEANING = "h(q, v): Coriolis and centrifugal torque and gravity of the bodies, without laws"
FORWARD_MEANING = (
    "accelerations at torque tau: mass_matrix(q) a = tau - inverse_dynamics(q, v, 0); friction that depends on load is "
    "that at a = 0, and a joint at v = 0 has no dry friction"
)
FIXED_JOINTS_NOTE = "the code holds it there, too"  # joints that the model holds fixed
MIN_SMOOTHING_WIDTH = 1e-9  # [rad/s or m/s] width of smoothing
MIN_EIGENVALUE_RATIO = 1e-12  # least ratio of eigenvalues of a mass matrix that is not singular by rounding
ACCELERATION_SYMBOL = re.compile(r"\ba\b")  # in the equation of a law
JACOBIAN_MEANING = (
    "Jacobian (6, n) by rows, of {}: linear velocity of its origin, then angular velocity, both in the axes "
    "of the base (LOCAL_WORLD_ALIGNED of Pinocchio), are jacobian(q) v"
)
WITH_PAYLOAD = (
    "torque of a body fixed to {0} alone: add it to inverse_dynamics, to tracking_torque or, at v = a = 0, to gravity; "
    "payload: mass [kg], first moment x, y, z [kg.m], inertia xx, xy, yy, xz, yz, zz [kg.m2], about the origin and in "
    "the axes of {0}; friction that depends on load does not include it"
)


@dataclass(frozen=True)
class Function:
    """A function of the motion: names of its arguments, and its outputs as nodes of one graph."""

    name: str
    arguments: tuple[str, ...]  # "q", "v", "a", "v_desired", "tau": (n,); "payload": (10,); "width"
    result: str
    outputs: tuple[Scalar, ...]  # (n,), or by rows (n * n,) or (6 * n,)
    meaning: str


@dataclass(frozen=True)
class Program:
    """Functions of a model over one graph."""

    graph: Graph
    functions: tuple[Function, ...]


def program_of(
    model: Model, *, tracking: bool = False, further: Collection[str] = (), link: str | None = None
) -> Program:
    """Functions of a model.

    Args:
        model: rigid bodies and laws.
        tracking: whether friction by a desired velocity is written.
        further: functions on request: "nonlinear", "forward", "jacobian", "payload".
        link: link of the Jacobian and the payload; None: that of the last joint.

    Raises:
        RobotError: a joint is neither revolute nor prismatic, no link has that name, or the mass matrix of "forward" is
            not positive definite.
    """
    graph, tree, n = Graph(), tree_of(model), len(model.robot.joints)
    zero = np.array([graph.constant(0.0)] * n)
    q, v, a = motion = tuple(vector(graph, key, n) for key in "qva")
    load = rigid_torque(graph, tree, q, v, a)
    signals = dict(zip(("q", "v", "a", "load"), (*motion, load), strict=True))
    weight = rigid_torque(graph, tree, q, zero, zero)
    graph.section = "rotors"
    rotors = rotor_torque(tree, a)
    laws = rotors + law_expressions(graph, model, signals)
    matrix = mass_matrix(graph, tree, q) + _coupled(graph, model, q)
    graph.section = "sum"
    functions = [
        _function("inverse_dynamics", "q v a", "tau", load + laws, "torque of the bodies and of all laws"),
        _function("gravity", "q", "tau", weight, "torque of gravity"),
        _function("laws", "q v a", "tau", laws, LAWS_MEANING),
        _function("mass_matrix", "q", "mass", matrix.ravel(), MASS_MEANING),
    ]
    if tracking:
        graph.section = "inverse width"
        rate = 1.0 / binary("maximum", graph.variable("width"), graph.constant(MIN_SMOOTHING_WIDTH))
        smooth = law_expressions(graph, model, signals, (vector(graph, "v_desired", n), rate))
        graph.section = "sum"
        functions.append(_function("tracking_torque", "q v a v_desired width", "tau", load + rotors + smooth, TRACKING))
    bias = rigid_torque(graph, tree, q, v, zero)
    if "nonlinear" in further:
        functions.append(_function("nonlinear_effects", "q v", "tau", bias, NONLINEAR_MEANING))
    if "forward" in further:
        _check_mass(model)
        still = law_expressions(graph, model, {**signals, "a": zero, "load": bias})
        graph.section = "accelerations by the factors of the mass matrix"
        solved = accelerations(graph, matrix, vector(graph, "tau", n) - bias - still)
        functions.append(_function("forward_dynamics", "q v tau", "a", solved, FORWARD_MEANING))
    frame = frame_of(model, link)
    if "jacobian" in further:
        rows = jacobian(graph, tree, frame, q).ravel()
        functions.append(_function("frame_jacobian", "q", "jacobian", rows, JACOBIAN_MEANING.format(frame.name)))
    if "payload" in further:
        torque = payload_torque(graph, tree, frame, motion, vector(graph, "payload", 10))
        functions.append(_function("payload_torque", "q v a payload", "tau", torque, WITH_PAYLOAD.format(frame.name)))
    return Program(graph, tuple(functions))


def _check_mass(model: Model) -> None:
    """Check that the mass matrix can be inverted, at random positions."""
    robot, whole = model.robot, model.bodies()
    lower, upper = (np.clip(limit, -3, 3) for limit in (robot.lower, robot.upper))
    q = np.random.default_rng(0).uniform(lower, upper, (100, len(robot.joints)))
    masses = mass_matrices(whole, whole.createData(), configuration(robot, q), robot.drive)
    inertias = np.linalg.eigvalsh(masses)
    if not (inertias[:, 0] > MIN_EIGENVALUE_RATIO * inertias[:, -1]).all():
        raise RobotError(
            f"forward dynamics of {robot.name} cannot be written, since its mass matrix is not positive definite "
            f"everywhere; state the armature of its joints, identify physically consistent inertias, or leave "
            f"`forward` out"
        )


def vector(graph: Graph, key: str, size: int) -> Expressions:
    """Variables of an argument that is an array (size,)."""
    return np.array([graph.variable(f"{key}[{j}]") for j in range(size)])


def _function(name: str, arguments: str, result: str, outputs: Expressions, meaning: str) -> Function:
    return Function(name, tuple(arguments.split()), result, tuple(outputs), meaning)


def _coupled(graph: Graph, model: Model, q: Expressions) -> Expressions:
    """Part of the mass matrix (n, n) of the laws that are linear in acceleration, as a coupling of two joints."""
    laws = (law for law in torque_model(model).laws if ACCELERATION_SYMBOL.search(law.effect.equation))
    model, zero = replace(model, laws=tuple(laws)), np.array([graph.constant(0.0)] * len(q))
    units = np.array([graph.constant(x) for x in np.eye(len(q)).ravel()]).reshape(len(q), len(q))
    columns = [law_expressions(graph, model, {"q": q, "v": zero, "a": unit, "load": zero}) for unit in units]
    return np.array(columns).T


class Frame(NamedTuple):
    """A frame that moves with a body."""

    name: str
    body: int
    rotation: Array  # (3, 3) in the frame of the body's joint [1]
    position: Array  # (3,) [m]


def frame_of(model: Model, link: str | None) -> Frame:
    """Frame of a link by name; None: frame of the last joint, about which models state a payload.

    Raises:
        RobotError: no link that moves has that name.
    """
    robot = model.robot
    if link is None:
        body = own_body(robot, len(robot.joints) - 1)
        return Frame(f"the frame of joint {robot.joints[-1]} ({robot.links[body]})", body, np.eye(3), np.zeros(3))
    frames = {x.name: x for x in robot.model.frames if x.type == pin.FrameType.BODY and x.parentJoint > 0}
    if link not in frames:
        close = get_close_matches(link, frames, n=3, cutoff=0.6)
        advice = f"did you mean {' or '.join(close)}?" if close else f"choose from {shorten(list(frames))}"
        raise RobotError(f"{robot.name} has no link {link!r} that moves; {advice}")
    place = frames[link].placement
    return Frame(f"the frame of link {link}", frames[link].parentJoint - 1, exact(place.rotation), place.translation)


def jacobian(graph: Graph, tree: Bodies, frame: Frame, q: Expressions) -> Expressions:
    """Jacobian (6, n) of a frame in the axes of the base: linear rows, then angular [m/rad, 1/m or 1]."""
    zero, angles = graph.constant(0.0), tree.drive @ q + tree.rest
    chain = [frame.body]
    while (parent := tree.bodies[chain[0]].parent) >= 0:
        chain.insert(0, parent)
    turn: Expressions = np.eye(3) + zero
    origin: Expressions = np.array([zero] * 3)
    axes: dict[int, tuple[Expressions, Expressions]] = {}
    for k in chain:
        body = tree.bodies[k]
        graph.section = f"{body.name}: position"
        turned, offset = placement(graph, body, graph.scalar(angles[k]))
        origin = origin + turn @ offset
        axes[k] = turn @ (body.rotation @ body.axis), origin
        turn = turn @ turned
    tip, columns = origin + turn @ frame.position, np.full((6, len(tree.bodies)), zero)
    for k, (axis, origin) in axes.items():
        graph.section = f"{tree.bodies[k].name}: column of the Jacobian"
        prismatic = tree.bodies[k].prismatic
        columns[:3, k] = axis if prismatic else cross(axis, tip - origin)
        columns[3:, k] = zero if prismatic else axis
    whole: Expressions = columns @ tree.drive
    return whole


def payload_torque(
    graph: Graph, tree: Bodies, frame: Frame, motion: tuple[Expressions, Expressions, Expressions], payload: Expressions
) -> Expressions:
    """Torque (n,) of ten inertial parameters in a frame, in Pinocchio's order.

    motion: q, v, a (n,) [rad or m, and their derivatives]; payload: (10,) [kg, kg.m, kg.m2].
    """
    mass, x, y, z, xx, xy, yy, xz, yz, zz = payload
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    states, none = motions(graph, tree, *motion), np.array([graph.constant(0.0)] * 3)
    w, alpha, acc, *_ = states[frame.body]
    graph.section = "payload: force and moment"
    acc = acc + cross(alpha, frame.position) + cross(w, cross(w, frame.position))
    turn, position = frame.rotation, frame.position
    state = State(turn.T @ w, turn.T @ alpha, turn.T @ acc, turn, position)
    forces = [(none, none)] * len(states)
    force, moment = wrench(mass, np.array([x, y, z]), inertia, state)
    forces[frame.body] = carried_wrench(turn, position, force, moment)
    return joint_torque(graph, tree, states, forces)


def mass_matrix(graph: Graph, tree: Bodies, q: Expressions) -> Expressions:
    """Mass matrix (n, n) of the bodies and their rotors, by the composite rigid body algorithm.

    q: (n,) expressions [rad or m]. Source: Featherstone, Rigid Body Dynamics Algorithms, 2008, section 6.2.
    """
    zero, bodies = graph.constant(0.0), tree.bodies
    angles = [graph.scalar(x) for x in tree.drive @ q + tree.rest]
    places = [placement(graph, body, x) for body, x in zip(bodies, angles, strict=True)]
    masses, moments, inertias = ([getattr(x, key) for x in bodies] for key in ("mass", "moment", "inertia"))
    matrix = np.full((len(bodies), len(bodies)), zero)
    for k in reversed(range(len(bodies))):
        body, mass, moment, inertia = bodies[k], masses[k], moments[k], inertias[k]
        graph.section = f"{body.name}: mass matrix"
        wrench = (
            (mass * body.axis, cross(moment, body.axis))
            if body.prismatic
            else (cross(body.axis, moment), inertia @ body.axis)
        )
        i = k
        while i >= 0:
            matrix[k, i] = matrix[i, k] = bodies[i].axis @ wrench[0 if bodies[i].prismatic else 1]
            wrench, i = carried_wrench(*places[i], *wrench), bodies[i].parent
        if body.parent >= 0:
            graph.section = f"{body.name}: inertia with the bodies after it"
            turn, offset = places[k]
            first = turn @ moment
            masses[body.parent] = masses[body.parent] + mass
            moments[body.parent] = moments[body.parent] + first + mass * offset
            inertias[body.parent] = inertias[body.parent] + _turned(body, inertia, angles[k])
            about = first + 0.5 * mass * offset
            x, y, z = 2.0 * offset * about
            across = np.outer(-offset, about)
            shift = np.diag([y + z, z + x, x + y]) + (across + across.T) * (1 - np.eye(3))  # -[offset][g] - [g][offset]
            inertias[body.parent] = inertias[body.parent] + shift
    graph.section = "mass matrix with rotors"
    return tree.drive.T @ (matrix + np.diag(tree.rotors)) @ tree.drive


def _turned(body: Body, inertia: Expressions, angle: Scalar) -> Expressions:
    """Inertia (3, 3) of a body in the axes of its parent, turned about the third axis of a basis [kg.m2]."""
    if body.prismatic:
        return _congruent(body.rotation, inertia)
    first = np.eye(3)[int(np.argmin(np.abs(body.axis)))]
    first = first - (first @ body.axis) * body.axis
    first /= np.linalg.norm(first)
    basis = exact(np.column_stack([first, np.cross(body.axis, first), body.axis]))
    (xx, xy, xz), (_, yy, yz), (*_, zz) = _congruent(basis.T, inertia)
    s, c = unary("sin", angle), unary("cos", angle)
    change = c * (xx - yy) - 2.0 * s * xy
    xz, yz, xy = c * xz - s * yz, s * xz + c * yz, xy + s * change
    spun = np.array([[yy + c * change, xy, xz], [xy, xx - c * change, yz], [xz, yz, zz]])
    return _congruent(exact(body.rotation @ basis), spun)


def _congruent(turn: Array, inertia: Expressions) -> Expressions:
    """R I R' (3, 3) of a symmetric I."""
    left, out = turn @ inertia, inertia.copy()
    for i, j in zip(*np.triu_indices(3), strict=True):
        out[i, j] = out[j, i] = left[i] @ turn[j]
    return out


def accelerations(graph: Graph, matrix: Expressions, torque: Expressions) -> Expressions:
    """Solution a (n,) of matrix @ a = torque by M = L' D L, which keeps the zeros of branches.

    Source: Featherstone, Rigid Body Dynamics Algorithms, 2008, section 6.5.
    """
    rest, n, a = matrix.copy(), len(matrix), list(torque)
    factor, inverse = np.full((n, n), graph.constant(0.0)), dict[int, Scalar]()
    for k in reversed(range(n)):
        inverse[k] = 1.0 / rest[k, k]
        for i in range(k):
            factor[k, i] = rest[k, i] * inverse[k]
            for j in range(i + 1):
                rest[i, j] = rest[j, i] = rest[i, j] - factor[k, i] * rest[k, j]
            a[i] = a[i] - factor[k, i] * a[k]
    for k in range(n):
        a[k] = a[k] * inverse[k] - sum((factor[k, i] * a[i] for i in range(k)), graph.constant(0.0))
    return np.array(a)
