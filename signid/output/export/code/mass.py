"""Mass matrix of a model as expressions, and accelerations by its factors."""

from __future__ import annotations

import numpy as np

from ....types import Array
from .graph import Graph, Scalar, unary
from .rigid import Bodies, Body, Expressions, carried_wrench, cross, exact, placement


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
            turned = _turned(body, inertia, angles[k])
            inertias[body.parent] = inertias[body.parent] + turned + _shift(offset, first + 0.5 * mass * offset)
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


def _shift(offset: Expressions, moment: Expressions) -> Expressions:
    """-[p][g] - [g][p] (3, 3) [kg.m2] of an offset p [m] and a moment g [kg.m]."""
    x, y, z = 2.0 * offset * moment
    across = np.outer(-offset, moment)
    return np.diag([y + z, z + x, x + y]) + (across + across.T) * (1 - np.eye(3))


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
