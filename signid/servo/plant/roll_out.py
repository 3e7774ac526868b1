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
from .course import (
    JoinedGrids,
    RobotCourse,
    bodies_of,
    copies_of,
    course,
    motion_of,
    part,
    recorded_course,
    single,
    substeps,
)
from .kernel import BEGIN, DEFLECTION, HALF, RELATIVE, SIDE, Starts, advance, advance_links, simulate
from .torque import ARMATURE, FAST, GAP, LINK_ENCODER, LOOP, ZERO, actuate, new_state


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
    if single(robot):
        exact = recorded_course(model, grid) if start is None else course(robot, motion)
        return roll_out_along(exact, servos, grid, horizon)
    driven = [j for j, joint in enumerate(grid.joints) if joint in servos]
    if not driven:
        return grid.q.copy()
    acting = [servos[grid.joints[j]] for j in driven]
    inertia = effective_inertia(robot, configuration(robot, motion.q[:: max(len(motion.q) // 20, 1)])).min(axis=0)
    rows = JoinedGrids((grid,), tuple(driven), substeps(grid.step, acting, inertia[driven]))
    drives, state, out = rows.drives(copies_of([acting])), new_state(len(driven)), grid.q.copy()
    state.armature[:], state.play[HALF] = drives.numbers[0, :, ARMATURE], 0.5 * drives.numbers[0, :, GAP]
    loose = bool(np.any(drives.numbers[0, :, GAP] > 0)) or None
    along = LoopMotion(np.stack(motion), np.array(driven), _restart(grid, horizon), out)
    loop(tree_of(robot), along, drives, state, loose)
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
    """Robot of A axes and n joints as a product of exponentials; axis 0 is the world. Units as of Pinocchio's motions.

    Source: Lynch, Park, Modern Robotics, 2017, chapter 8; Featherstone, Rigid Body Dynamics Algorithms, 2008.
    """

    parent: Indices  # (A,) axis before
    screw: Array  # (A, 6) [1 and m] of the axes at zero
    action: Array  # (A, 2, 6, 6) [1 and m] of a screw on motions, and its square
    body: Array  # (A, 6, 6) [kg, kg.m and kg.m2] inertia of the body that an axis moves, at zero
    drive: Array  # (A, n) [1] rates of the axes per rate of the joints
    rest: Array  # (A,) [rad or m]
    moved: Array  # (A, 5, 6) [any] memory: velocity, acceleration, force, momentum, and the rate of the screw
    back: Array  # (A, 6, 6) [1 and m] memory: motions of the axis before, as the axis sees them
    inertia: Array  # (A, 6, 6) [kg, kg.m and kg.m2] memory: of all bodies that an axis moves


class LoopMotion(NamedTuple):
    """Recorded motion of n joints, and the simulated positions."""

    motion: Array  # (3, N, n) [rad or m and per s, per s2] positions, speeds and accelerations
    driven: Indices  # (m,) columns of the joints with a drive
    restart: int  # rows after which the state is set to the measured one
    out: Array  # (N, n) [rad or m] simulated positions


def tree_of(robot: Robot) -> Tree:
    """Axes of the model of a robot; joints that are neither axes nor independent axes stay where they are."""
    model, data, joints = robot.model, robot.model.createData(), list(robot.model.joints)
    zero = configuration(replace(robot, rest=0 * robot.rest), np.zeros(len(robot.joints)))
    pin.computeJointJacobians(model, data, zero)
    screw, parent = np.vstack([np.zeros(6), data.J.T]), np.arange(-1, model.nv)
    body, moved, back = np.zeros((len(screw), 6, 6)), np.zeros((len(screw), 5, 6)), np.zeros((len(screw), 6, 6))
    for joint, inertia, at, before in list(zip(joints, model.inertias, data.oMi, model.parents, strict=True))[1:]:
        body[joint.idx_v + joint.nv] = at.act(inertia).matrix()
        parent[joint.idx_v + 1] = joints[before].idx_v + joints[before].nv if before else 0
    action = np.array([[(one := pin.Motion(axis).action), one @ one] for axis in screw])
    moved[0, 1] = -model.gravity.vector
    drive, rest = np.vstack([0 * robot.drive[:1], robot.drive]), np.array([0.0, *robot.rest])
    return Tree(parent, screw, action, body, drive, rest, moved, back, np.zeros_like(body))


@LOOP
def act(x, y, out):  # type: ignore[no-untyped-def]
    """Add to out (6,) the change of a motion y under a motion x; forces with their halves exchanged change alike."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i] += x[3 + j] * y[k] - x[3 + k] * y[j] + x[j] * y[3 + k] - x[k] * y[3 + j]
        out[3 + i] += x[3 + j] * y[3 + k] - x[3 + k] * y[3 + j]


@LOOP
def move_bodies(tree, motion):  # type: ignore[no-untyped-def]
    """Velocities, accelerations and forces of the bodies; motion: (3, n) positions, speeds and accelerations."""
    count, n = tree.drive.shape
    for k in range(1, count):
        moved, before, back, screw = tree.moved[k], tree.moved[tree.parent[k]], tree.back[k], tree.screw[k]
        angle, rate, change = tree.rest[k], 0.0, 0.0
        for j in range(n):
            angle += tree.drive[k, j] * motion[0, j]
            rate += tree.drive[k, j] * motion[1, j]
            change += tree.drive[k, j] * motion[2, j]
        turns = screw[3] != 0.0 or screw[4] != 0.0 or screw[5] != 0.0
        sine, cosine = np.sin(angle) if turns else angle, 1.0 - np.cos(angle)
        for i in range(6):
            speed, acceleration = rate * screw[i], change * screw[i]
            moved[4, i] = speed
            for j in range(i // 3 * 3, 6):  # the angular part does not depend on the linear one
                one = cosine * tree.action[k, 1, i, j] - sine * tree.action[k, 0, i, j] + (1.0 if i == j else 0.0)
                speed += one * before[0, j]
                acceleration += one * before[1, j]
                back[i, j] = one
            moved[0, i], moved[1, i] = speed, acceleration
        act(moved[0], moved[4], moved[1])
        for i in range(6):
            momentum = 0.0
            for j in range(6):
                momentum += tree.body[k, (i + 3) % 6, j] * moved[0, j]
            moved[2, i], moved[3, i] = 0.0, momentum
        act(moved[0], moved[3], moved[2])
        for i in range(6):
            force = moved[2, (i + 3) % 6]
            for j in range(6):
                force += tree.body[k, i, j] * moved[1, j]
            moved[4, i] = force


@LOOP
def load_joints(tree, loads):  # type: ignore[no-untyped-def]
    """Torque (n,) of the joints under the forces of `move_bodies`, which become those of all bodies beyond an axis."""
    count, n = tree.drive.shape
    for j in range(n):
        loads[j] = 0.0
    for k in range(count - 1, 0, -1):
        force, before, back = tree.moved[k, 4], tree.moved[tree.parent[k], 4], tree.back[k]
        torque = 0.0
        for i in range(6):
            torque += tree.screw[k, i] * force[i]
        for j in range(n):
            loads[j] += tree.drive[k, j] * torque
        for i in range(6):
            total = before[i]
            for j in range(3 + i // 3 * 3):
                total += back[j, i] * force[j]
            before[i] = total


@njit(cache=True, error_model="numpy", fastmath=FAST)
def torques(tree, q, v, a):  # type: ignore[no-untyped-def]
    """Torque (N, n) [N.m or N] of the bodies along N rows of positions, speeds and accelerations, (N, n) each."""
    out, motion = np.empty(q.shape), np.empty((3, q.shape[1]))
    for t in range(len(q)):
        for j in range(q.shape[1]):
            motion[0, j], motion[1, j], motion[2, j] = q[t, j], v[t, j], a[t, j]
        move_bodies(tree, motion)
        load_joints(tree, out[t])
    return out


@LOOP
def rigid_bodies(tree, motion, mass, loads):  # type: ignore[no-untyped-def]
    """Mass matrix (n, n) and torque (n,) of the joints; motion: (3, n) positions, speeds and accelerations."""
    move_bodies(tree, motion)
    load_joints(tree, loads)
    count, n = tree.drive.shape
    for i in range(n):
        for j in range(n):
            mass[i, j] = 0.0
    for k in range(1, count):
        for i in range(6):
            for j in range(6):
                tree.inertia[k, i, j] = tree.body[k, i, j]
    for k in range(count - 1, 0, -1):
        other, now, new = k, tree.moved[k, 2], tree.moved[k, 3]
        for i in range(6):
            now[i] = 0.0
            for j in range(6):
                now[i] += tree.inertia[k, i, j] * tree.screw[k, j]
        while other > 0:
            both, parent, back = 0.0, tree.parent[other], tree.back[other]
            for i in range(6):
                both += tree.screw[other, i] * now[i]
                new[i] = 0.0
                for j in range(6):
                    new[i] += back[j, i] * now[j]
            for i in range(n):
                for j in range(n if tree.drive[k, i] != 0.0 else 0):
                    mass[i, j] += tree.drive[k, i] * tree.drive[other, j] * both
                    mass[j, i] += tree.drive[k, i] * tree.drive[other, j] * (both if other != k else 0.0)
            now, new, other = new, now, parent
        parent, back = tree.parent[k], tree.back[k]
        for i in range(6):
            for j in range(6):
                now[j] = 0.0
                for m in range(6):
                    now[j] += back[m, i] * tree.inertia[k, m, j]
            for j in range(6):
                for m in range(6):
                    tree.inertia[parent, i, j] += now[m] * back[m, j]


@njit(cache=True, error_model="numpy", fastmath=FAST)
def loop(tree, along, drives, state, loose):  # type: ignore[no-untyped-def]
    """Write the positions of the closed loop into `along.out`; loose: None without backlash: less is compiled."""
    motion, driven, restart, out = along
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
