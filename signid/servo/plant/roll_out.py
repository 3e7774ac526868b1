"""Roll-outs of the closed loop from commands alone, with the exact dynamics of the robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numba import njit

from ...model import Model
from ...robot import configuration
from ...robot.dynamics import effective_inertia
from ...servos import Servo, ServoGrid
from ...types import Array, Indices, Robot
from .course import JoinedGrids, RobotCourse, bodies_of, copies_of, course, motion_of, part, single, substeps
from .kernel import BEGIN, DEFLECTION, HALF, RELATIVE, SIDE, Starts, advance, advance_links, simulate
from .torque import ARMATURE, GAP, LINK_ENCODER, LOOP, ZERO, actuate, new_state


def roll_out(
    model: Model,
    servos: Mapping[str, Servo],
    grid: ServoGrid,
    horizon: float | None = None,
    start: tuple[Array, Array] | None = None,
) -> Array:
    """Simulate a recording from its commands alone.

    Args:
        model: bodies and laws of the robot.
        servos: drives by joint; joints without one follow the recorded motion.
        grid: the recording.
        horizon: time [s] after which the state is set to the measured one again; None: never.
        start: positions (n,) [rad or m] and speeds (n,) [rad/s or m/s] of the first row; None: the measured ones.

    Returns:
        Positions (N, n) [rad or m]; the recorded ones where the robot is set to them.
    """
    robot = bodies_of(model, grid.joints)
    motion = motion_of(grid)
    if start is not None:
        for x, first in zip(motion, start, strict=False):
            x[0] = first
    if single(robot):  # its course is exact
        return roll_out_along(course(robot, motion), servos, grid, horizon)
    driven = [j for j, joint in enumerate(grid.joints) if joint in servos]
    if not driven:
        return grid.q.copy()
    acting = [servos[grid.joints[j]] for j in driven]
    inertia = effective_inertia(robot, configuration(robot, motion.q[:: max(len(motion.q) // 20, 1)])).min(axis=0)
    rows = JoinedGrids((grid,), tuple(driven), substeps(grid.step, acting, inertia[driven]))
    drives, state, out = rows.drives(copies_of([acting])), new_state(len(driven)), grid.q.copy()
    state.armature[:], state.play[HALF] = drives.numbers[0, :, ARMATURE], 0.5 * drives.numbers[0, :, GAP]
    loose = bool(np.any(drives.numbers[0, :, GAP] > 0)) or None
    loop(tree_of(robot), np.stack(motion), out, drives, np.array(driven), state, _restart(grid, horizon), loose)
    return out


def roll_out_along(
    along: RobotCourse, servos: Mapping[str, Servo], grid: ServoGrid, horizon: float | None = None
) -> Array:
    """The same of a robot that is linear about the recorded motion; exact for a single revolute joint.

    Args:
        along: the robot along the motion of the grid.
        servos: drives by joint; joints without one follow the recorded motion.
        grid: the recording.
        horizon: time [s] after which the state is set to the measured one again; None: never.

    Returns:
        Positions (N, n) [rad or m]; the recorded ones where the robot is set to them.
    """
    driven = [j for j, joint in enumerate(grid.joints) if joint in servos]
    out, some = grid.q.copy(), part(along, driven)
    if not driven:
        return out
    acting = [servos[grid.joints[j]] for j in driven]
    parts = substeps(grid.step, acting, np.diagonal(some.mass, axis1=1, axis2=2).min(0))
    drives = JoinedGrids((grid,), tuple(driven), parts).drives(copies_of([acting]))
    first = np.arange(0, len(grid) - 1, min(_restart(grid, horizon), len(grid) - 1))
    lengths = np.diff(first, append=len(grid) - 1)
    states = (np.ascontiguousarray(x[None, first]) for x in some.motion[:2])
    paths = simulate(some.bodies, drives, Starts(first, lengths, int(lengths.max()), *states))[0][0]
    for start, rows, path in zip(first, lengths, paths, strict=True):
        out[start : start + rows + 1, driven] = path[: rows + 1]
    return out


def saturated_share(servos: Mapping[str, Servo], grid: ServoGrid, v: Array) -> Array:
    """Share (n,) [1] of rows in which the limit of a drive cuts its torque; 0 for joints without one.

    The positions of the grid and the speeds v (N, n) [rad/s or m/s] are those of the closed loop.
    """
    driven = [j for j, joint in enumerate(grid.joints) if joint in servos]
    drives = JoinedGrids((grid,), tuple(driven), 1).drives(copies_of([[servos[grid.joints[j]] for j in driven]]))
    act, cut, loads = np.empty((5, len(driven))), np.zeros(len(grid.joints)), np.zeros(len(driven))
    q, v = (np.ascontiguousarray(x[:, driven]) for x in (grid.q, v))
    for k in range(len(grid)):
        actuate(drives, 0, k, (q[k], v[k], loads), act)
        cut[driven] += np.any(act[3:] != 0.0, axis=0)
    return cut / len(grid)


def _restart(grid: ServoGrid, horizon: float | None) -> int:
    """Rows from one measured state to the next."""
    return len(grid) if horizon is None else max(int(round(horizon * grid.rate)), 1)


class Tree(NamedTuple):
    """Robot of A axes and n joints as a product of exponentials, about the origin of the world at zero; axis 0 rests.

    Source: Lynch, Park, Modern Robotics, 2017, section 4.1; Featherstone, Rigid Body Dynamics Algorithms, 2008.
    """

    parent: Indices  # (A,) axis before
    screw: Array  # (A, 6) speed and angular velocity [1 or m, 1]
    cross: Array  # (A, 2, 3, 3) cross product with the angular velocity, and its square
    shift: Array  # (A, 3, 3) speed, and these times the speed
    body: Array  # (A, 13) mass, lever and inertia about it of the body of an axis [kg, m, kg.m2]
    gravity: Array  # (3,) [m/s2]
    drive: Array  # (A, n) [1] rates of the axes per rate of the joints
    rest: Array  # (A,) [rad or m]
    place: Array  # (A, 4, 3) memory: rotation and shift from zero
    wrench: Array  # (A, 5, 6) memory: screw, velocity, acceleration, force, momentum
    inertia: Array  # (A, 13) memory: mass, first moment, inertia about the origin of the world


def tree_of(robot: Robot) -> Tree:
    """Axes of the model of a robot; joints that are neither axes nor independent axes stay where they are."""
    model, data, joints = robot.model, robot.model.createData(), list(robot.model.joints)
    zero = configuration(replace(robot, rest=0 * robot.rest), np.zeros(len(robot.joints)))
    pin.computeJointJacobians(model, data, zero)
    screw, body, parent = np.vstack([np.zeros(6), data.J.T]), np.zeros((model.nv + 1, 13)), np.arange(-1, model.nv)
    for joint, inertia, at, before in list(zip(joints, model.inertias, data.oMi, model.parents, strict=True))[1:]:
        own = at.act(inertia)
        body[joint.idx_v + joint.nv] = [own.mass, *own.lever, *own.inertia.ravel()]
        parent[joint.idx_v + 1] = joints[before].idx_v + joints[before].nv if before else 0
    cross = np.array([[(w := pin.skew(axis)), w @ w] for axis in screw[:, 3:]])
    shift = np.stack([screw[:, :3], *(np.einsum("aij,aj->ai", cross[:, k], screw[:, :3]) for k in range(2))], axis=1)
    drive, rest = np.vstack([0 * robot.drive[:1], robot.drive]), np.array([0.0, *robot.rest])
    memory = np.zeros((len(screw), 4, 3)), np.zeros((len(screw), 5, 6)), np.zeros((len(screw), 13))
    memory[0][0, :3] = np.eye(3)
    return Tree(parent, screw, cross, shift, body, np.array(model.gravity.linear), drive, rest, *memory)


@LOOP
def cross(x, y, i):  # type: ignore[no-untyped-def]
    """Component i of the cross product of x and y, (3,) each."""
    j, k = (i + 1) % 3, (i + 2) % 3
    return x[j] * y[k] - x[k] * y[j]


@LOOP
def momentum(inertia, x, i):  # type: ignore[no-untyped-def]
    """Component i of a spatial inertia (13,) times a motion x (6,)."""
    lever, speed, turn, k = inertia[1:4], x[:3], x[3:], i % 3
    if i < 3:
        return inertia[0] * speed[k] + cross(turn, lever, k)
    row = 4 + 3 * k
    total = cross(lever, speed, k)
    for j in range(3):
        total += inertia[row + j] * turn[j]
    return total


@LOOP
def move(tree, k, at):  # type: ignore[no-untyped-def]
    """Place and motion of axis k, and inertia of its body about the world's origin; at: position, rate, its change."""
    (angle, rate, change), before = at, tree.parent[k]
    place, parent, wrench, inertia, body = (
        tree.place[k],
        tree.place[before],
        tree.wrench[k],
        tree.inertia[k],
        tree.body[k],
    )
    sine, cosine = np.sin(angle), 1.0 - np.cos(angle)
    for i in range(3):
        place[3, i] = parent[3, i]
        for j in range(3):
            place[i, j] = parent[i, j]
    for i in range(3):
        for j in range(3):
            shift = angle * tree.shift[k, 0, j] + cosine * tree.shift[k, 1, j] + (angle - sine) * tree.shift[k, 2, j]
            place[3, i] += parent[i, j] * shift
            for m in range(3):
                place[i, m] += parent[i, j] * (sine * tree.cross[k, 0, j, m] + cosine * tree.cross[k, 1, j, m])
    inertia[0] = body[0]
    for i in range(3):
        wrench[0, i], wrench[0, 3 + i], inertia[1 + i] = 0.0, 0.0, place[3, i]
        for j in range(3):
            wrench[0, i] += place[i, j] * tree.screw[k, j]
            wrench[0, 3 + i] += place[i, j] * tree.screw[k, 3 + j]
            inertia[1 + i] += place[i, j] * body[1 + j]
    for i in range(3):
        wrench[0, i] += cross(place[3], wrench[0, 3:], i)
        for j in range(3):
            total = -inertia[1 + i] * inertia[1 + j]
            if i == j:
                for m in range(3):
                    total += inertia[1 + m] ** 2
            total *= body[0]
            for m in range(3):
                for o in range(3):
                    total += place[i, m] * body[4 + 3 * m + o] * place[j, o]
            inertia[4 + 3 * i + j] = total
    for i in range(3):
        inertia[1 + i] *= body[0]
    for i in range(6):
        wrench[1, i] = tree.wrench[before, 1, i] + rate * wrench[0, i]
    speed, turn, own, axis = wrench[1, :3], wrench[1, 3:], wrench[0, :3], wrench[0, 3:]
    for i in range(6):
        swing = cross(turn, own, i) + cross(speed, axis, i) if i < 3 else cross(turn, axis, i - 3)
        wrench[2, i] = tree.wrench[before, 2, i] + change * wrench[0, i] + rate * swing


@LOOP
def rigid_bodies(tree, motion, mass, loads):  # type: ignore[no-untyped-def]
    """Mass matrix (n, n) and torque (n,) of the joints; motion: (3, n) positions, speeds and accelerations."""
    count, n = tree.drive.shape
    mass[:], loads[:] = 0.0, 0.0
    for i in range(3):
        tree.wrench[0, 2, i] = -tree.gravity[i]
    for k in range(1, count):
        angle, rate, change = tree.rest[k], 0.0, 0.0
        for j in range(n):
            share = tree.drive[k, j]
            if share != 0.0:
                angle, rate = angle + share * motion[0, j], rate + share * motion[1, j]
                change += share * motion[2, j]
        move(tree, k, (angle, rate, change))
        of, velocity, force, push = tree.inertia[k], tree.wrench[k, 1], tree.wrench[k, 3], tree.wrench[k, 4]
        for i in range(6):
            force[i], push[i] = momentum(of, tree.wrench[k, 2], i), momentum(of, velocity, i)
        for i in range(3):
            force[i] += cross(velocity[3:], push, i)
            force[3 + i] += cross(velocity[3:], push[3:], i) + cross(velocity, push, i)
    for k in range(count - 1, 0, -1):
        screw, push, parent = tree.wrench[k, 0], tree.wrench[k, 4], tree.parent[k]
        for i in range(13):
            tree.inertia[parent, i] += tree.inertia[k, i]
        torque = 0.0
        for i in range(6):
            torque += screw[i] * tree.wrench[k, 3, i]
            push[i] = momentum(tree.inertia[k], screw, i)
            tree.wrench[parent, 3, i] += tree.wrench[k, 3, i]
        other = k
        while other > 0:
            both = 0.0
            for i in range(6):
                both += push[i] * tree.wrench[other, 0, i]
            for i in range(n):
                if tree.drive[k, i] != 0.0:
                    for j in range(n):
                        part = tree.drive[k, i] * tree.drive[other, j] * both
                        mass[i, j] += part
                        if other != k:
                            mass[j, i] += part
            other = tree.parent[other]
        for j in range(n):
            loads[j] += tree.drive[k, j] * torque


@njit(cache=True, error_model="numpy")
def loop(tree, motion, out, drives, driven, state, restart, loose):  # type: ignore[no-untyped-def]
    """Positions out (N, n) of the closed loop, with the state set to the measured one every `restart` rows.

    motion: (3, N, n) of all joints; driven: (m,) columns of those with a drive; loose: None if no joint has backlash,
    and the code for it is not compiled.
    """
    rows, n = motion.shape[1:]
    q, v, m, h = state.q, state.v, len(driven), drives.step
    now, whole, loads, mass = np.empty((3, n)), np.empty((n, n)), np.empty(n), np.empty((m, m))
    for k in range(rows - 1):
        if k % restart == 0:
            state.play[SIDE], state.play[SIDE + 1 :] = BEGIN, 0.0
            for i in range(m):
                q[i], v[i] = motion[0, k, driven[i]], motion[1, k, driven[i]]
                out[k, driven[i]] = q[i]
        for s in range(drives.parts):
            far = (s + 0.5) / drives.parts
            for x in range(3):
                for i in range(n):
                    now[x, i] = (1 - far) * motion[x, k, i] + far * motion[x, k + 1, i]
            for i in range(m):
                j, number, relative = driven[i], drives.numbers[0, i], state.play[RELATIVE, i]
                beyond = state.play[DEFLECTION, i] + 0.5 * h * relative
                state.half[i] = q[i] + 0.5 * h * v[i]
                state.seen[i] = state.half[i] + number[LINK_ENCODER] * beyond
                now[0, j], now[1, j], now[2, j] = state.half[i] + beyond - number[ZERO], v[i] + relative, 0.0
            rigid_bodies(tree, now, whole, loads)
            for i in range(m):
                state.loads[i] = loads[driven[i]]
                for j in range(m):
                    mass[i, j] = whole[driven[i], driven[j]]
            state.of[0] = 0.0
            if loose is not None:
                advance_links(drives, 0, k * drives.parts + s, mass, state, h)
            else:
                advance(drives, 0, k * drives.parts + s, mass, state, h)
            for i in range(m):
                q[i] = state.half[i] + 0.5 * h * v[i]
        for i in range(m):
            out[k + 1, driven[i]] = q[i] + drives.numbers[0, i, LINK_ENCODER] * state.play[DEFLECTION, i]
