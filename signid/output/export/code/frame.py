"""Frame of a link: its Jacobian, and the torque of a payload that is fixed to it, as expressions."""

from __future__ import annotations

from difflib import get_close_matches
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ....errors import RobotError, shorten
from ....model import Model
from ....robot.dynamics import own_body
from ....types import Array
from .graph import Graph
from .rigid import Bodies, Expressions, State, carried_wrench, cross, exact, joint_torque, motions, placement, wrench

JACOBIAN = (
    "Jacobian (6, n) by rows, of {}: linear velocity of its origin, then angular velocity, both in the axes "
    "of the base (LOCAL_WORLD_ALIGNED of Pinocchio), are jacobian(q) v"
)
PAYLOAD = (
    "torque of a body fixed to {0} alone: add it to inverse_dynamics, to tracking_torque or, at v = a = 0, to gravity; "
    "payload: mass [kg], first moment x, y, z [kg.m], inertia xx, xy, yy, xz, yz, zz [kg.m2], about the origin and in "
    "the axes of {0}; friction that depends on load does not include it"
)


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
