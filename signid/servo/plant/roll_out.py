"""Roll-outs of the closed loop from commands alone, with the exact dynamics of the robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin

from ...model import Model
from ...robot import configuration
from ...robot.dynamics import joint_inertia
from ...robot.joints import is_plain
from ...servos import Servo, ServoGrid
from ...types import Array, Robot
from .course import JoinedGrids, Moved, RobotCourse, bodies_of, copies_of, course, motion_of, part, single, substeps
from .kernel import BEGIN, DEFLECTION, HALF, RELATIVE, SIDE, Starts, advance, advance_links, simulate
from .torque import ARMATURE, GAP, LINK_ENCODER, ZERO, Drives, actuate, new_state


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
    rows = JoinedGrids((grid,), tuple(driven), substeps(grid.step, acting, effective(robot, motion, driven)))
    return _Loop(robot, motion, rows, rows.drives(copies_of([acting]))).run(_restart(grid, horizon))


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


def effective(robot: Robot, motion: Moved, joints: Sequence[int]) -> Array:
    """Smallest inertia (n,) [kg.m2 or kg] that each joint feels alone, others free, over some rows of a motion."""
    data = robot.model.createData()
    rows = configuration(robot, motion.q[:: max(len(motion.q) // 20, 1)])
    out = []
    for q in rows:
        mass = joint_inertia(robot, pin.crba(robot.model, data, q))[np.ix_(joints, joints)]
        out.append(np.diag(mass))
    return np.asarray(np.min(out, axis=0))


class _Loop:
    """Closed loop with Pinocchio in every substep."""

    def __init__(self, robot: Robot, motion: Moved, rows: JoinedGrids, drives: Drives) -> None:
        self.robot, self.motion, self.driven, self.drives = robot, np.stack(motion), list(rows.joints), drives
        self.square = np.ix_(self.driven, self.driven)
        self.grid, self.state = rows.grids[0], new_state(len(rows.joints))
        self.state.armature[:] = drives.numbers[0, :, ARMATURE]
        self.state.play[HALF], self.state.play[SIDE] = 0.5 * drives.numbers[0, :, GAP], BEGIN
        self.beyond = drives.numbers[0, :, LINK_ENCODER]
        self.loose = bool(np.any(drives.numbers[0, :, GAP] > 0))
        self.data = robot.model.createData()
        self.plain = all(is_plain(joint) for joint in list(robot.model.joints)[1:])

    def run(self, restart: int) -> Array:
        """Positions (N, n), with the state set to the measured one every `restart` rows."""
        out, q, v = self.grid.q.copy(), self.state.q, self.state.v
        for k in range(len(out) - 1):
            if k % restart == 0:
                q[:], v[:] = self.motion[:2, k, self.driven]
                self.state.play[SIDE:] = [[BEGIN], *4 * [[0.0]]]
                out[k, self.driven] = q
            self._row(k)
            out[k + 1, self.driven] = q + self.beyond * self.state.play[DEFLECTION]
        return out

    def _row(self, k: int) -> None:
        """Advance a row in place."""
        state, j, drives = self.state, self.driven, self.drives
        for s in range(drives.parts):
            far = (s + 0.5) / drives.parts
            q, v, a = (1 - far) * self.motion[:, k] + far * self.motion[:, k + 1]
            state.half[:] = state.q + 0.5 * drives.step * state.v
            relative = state.play[RELATIVE]
            beyond = state.play[DEFLECTION] + 0.5 * drives.step * relative
            state.seen[:] = state.half + self.beyond * beyond
            q[j], v[j], a[j] = state.half + beyond - drives.numbers[0, :, ZERO], state.v + relative, 0.0
            mass, state.loads[:] = self._dynamics(q, v, a)
            state.of[0] = 0.0
            step = advance_links if self.loose else advance
            step(drives, 0, k * drives.parts + s, mass, state, drives.step)
            state.q[:] = state.half + 0.5 * drives.step * state.v

    def _dynamics(self, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Mass matrix and torque of the driven joints; those that follow the recording keep its acceleration."""
        robot, j = self.robot, self.driven
        state = robot.drive @ q + robot.rest if self.plain else configuration(robot, q)
        torque = pin.rnea(robot.model, self.data, state, robot.drive @ v, robot.drive @ a) @ robot.drive
        mass = joint_inertia(robot, pin.crba(robot.model, self.data, state))
        return np.ascontiguousarray(mass[self.square]), np.asarray(torque[j])
