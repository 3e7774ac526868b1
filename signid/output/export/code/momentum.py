"""Momentum of the bodies and its rate without acceleration, as expressions: for observers of external torque."""

from __future__ import annotations

import numpy as np

from .graph import Graph
from .rigid import Bodies, Expressions, carried_wrench, cross, placement


def momentum_and_force(graph: Graph, tree: Bodies, q: Expressions, v: Expressions) -> tuple[Expressions, Expressions]:
    """Momentum M v (n,) [N.m.s or N.s] and C' v - g (n,) [N.m or N] of the bodies, without rotors.

    q, v: (n,) expressions [rad or m, and their derivative]. C' v is the derivative of the kinetic energy with respect
    to position: the momentum of all bodies after a joint times the cross product of the velocity of its body and its
    axis. Source of such a recursion: De Luca, Ferrajoli, IEEE ICRA 2009.
    """
    none = np.array([graph.constant(0.0)] * 3)
    angles, speeds = tree.drive @ q + tree.rest, tree.drive @ v
    places, motions = [], list[tuple[Expressions, Expressions, Expressions]]()
    for k, body in enumerate(tree.bodies):
        graph.section = f"{body.name}: motion"
        turn, offset = placement(graph, body, graph.scalar(angles[k]))
        w0, speed0, weight0 = motions[body.parent] if body.parent >= 0 else (none, none, none - tree.gravity)
        w, speed, along = turn.T @ w0, turn.T @ (speed0 + cross(w0, offset)), body.axis * speeds[k]
        w, speed = (w, speed + along) if body.prismatic else (w + along, speed)
        places.append((turn, offset))
        motions.append((w, speed, turn.T @ weight0))
    momenta = list[tuple[Expressions, Expressions]]()
    for body, (w, speed, _) in zip(tree.bodies, motions, strict=True):
        graph.section = f"{body.name}: momentum"
        linear = body.mass * speed + cross(w, body.moment)
        momenta.append((linear, cross(body.moment, speed) + body.inertia @ w))
    masses, moments = [body.mass for body in tree.bodies], [body.moment for body in tree.bodies]
    momentum, force = np.full((2, len(tree.bodies)), graph.constant(0.0))
    for k in reversed(range(len(tree.bodies))):
        body, (linear, angular), (w, speed, weight) = tree.bodies[k], momenta[k], motions[k]
        graph.section = f"{body.name}: momentum and torque with the bodies after it"
        momentum[k] = body.axis @ (linear if body.prismatic else angular)
        turned = cross(linear, w) if body.prismatic else cross(angular, w) + cross(linear, speed)
        heavy = masses[k] * weight if body.prismatic else cross(moments[k], weight)
        force[k] = body.axis @ (turned - heavy)
        if (parent := body.parent) >= 0:
            turn, offset = places[k]
            above, carried = momenta[parent], carried_wrench(turn, offset, linear, angular)
            momenta[parent] = above[0] + carried[0], above[1] + carried[1]
            masses[parent] = masses[parent] + masses[k]
            moments[parent] = moments[parent] + turn @ moments[k] + masses[k] * offset
    momentum, force = tree.drive.T @ momentum, tree.drive.T @ force
    return np.array([graph.scalar(x) for x in momentum]), np.array([graph.scalar(x) for x in force])
