"""Roll-outs of the closed loop from commands alone, with the exact dynamics of the robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin

from ...model import Model
from ...robot import configuration
from ...robot.dynamics import joint_inertia
from ...robot.joints import is_plain
from ...servos import DRIVE_LAWS, Servo, ServoGrid
from ...types import Array, Indices, Robot
from .commands import commands_at
from .course import Moved, RobotCourse, bodies_of, course, motion_of, part, single
from .friction import kick
from .kernel import PASSES, actuate, limited, numbers, simulate
from .substeps import substeps


def roll_out(model: Model, servos: Mapping[str, Servo], grid: ServoGrid, horizon: float | None = None) -> Array:
    """Simulate a recording from its commands alone.

    Args:
        model: bodies and laws of the robot.
        servos: drives by joint; joints without one follow the recorded motion.
        grid: the recording.
        horizon: time [s] after which the state is set to the measured one again; None: never.

    Returns:
        Positions (N, n) [rad or m]; the recorded ones where the robot is set to them.
    """
    robot = bodies_of(model, grid.joints)
    motion = motion_of(grid)
    if single(robot):  # its course is exact
        return roll_out_along(course(robot, motion), servos, grid, horizon)
    driven = [j for j, joint in enumerate(grid.joints) if joint in servos]
    if not driven:
        return grid.q.copy()
    acting = [servos[grid.joints[j]] for j in driven]
    parts = substeps(grid.step, acting, effective(robot, motion, driven))
    return _Loop(robot, grid, motion, driven, acting, parts).run(_restart(grid, horizon))


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
    drive = _Drives(grid, driven, acting, parts)
    restart = min(_restart(grid, horizon), len(grid) - 1)
    whole = np.arange(0, len(grid) - restart, restart)
    for starts, rows in ((whole, restart), (whole[-1:] + restart, len(grid) - 1 - whole[-1] - restart)):
        if rows > 0:
            for start, path in zip(starts, drive.along(some, starts, int(rows)), strict=True):
                out[start : start + rows + 1, driven] = path
    return out


def saturated_share(servos: Mapping[str, Servo], grid: ServoGrid, v: Array) -> Array:
    """Share (n,) [1] of rows in which the limit of a drive cuts its torque; 0 for joints without one.

    The positions of the grid and the speeds v (N, n) [rad/s or m/s] are those of the closed loop.
    """
    driven = [j for j, joint in enumerate(grid.joints) if joint in servos]
    drives = _Drives(grid, driven, [servos[grid.joints[j]] for j in driven], 1)
    act, cut = np.empty((4, len(driven))), np.zeros(len(grid.joints))
    q, v = (np.ascontiguousarray(x[:, driven]) for x in (grid.q, v))
    for k in range(len(grid)):
        drives.act(k, k, q[k], v[k], act)
        cut[driven] += act[3] != 0.0
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


class _Drives:
    """Drives of n joints and their commands on the substeps of a grid, as the compiled code reads them."""

    def __init__(self, grid: ServoGrid, driven: list[int], acting: list[Servo], parts: int) -> None:
        self.parts, self.h = parts, grid.step / parts
        self.numbers = np.array([[numbers(servo) for servo in acting]])
        self.laws = np.array([DRIVE_LAWS.index(servo.law) for servo in acting])
        each = [
            commands_at(grid, j, servo.kd_on, servo.delay, servo.profile_speed, parts)
            for j, servo in zip(driven, acting, strict=True)
        ]
        self.commands = np.ascontiguousarray(np.moveaxis(np.array(each), 0, 1))  # (7, n, N parts)
        self.variant = np.arange(len(driven))[None]
        self.on, self.voltage, self.gain = grid.on[:, driven], grid.voltage[:, driven], grid.gain[driven]

    def act(self, row: int, step: int, q: Array, v: Array, out: Array) -> None:
        """Torque, damping, friction bound and kind of limit, out (4, n), in a substep of a row at q and v, (n,)."""
        actuate(
            self.numbers,
            0,
            self.laws,
            q,
            v,
            self.commands,
            self.variant,
            step,
            self.on,
            self.voltage,
            row,
            self.gain,
            out,
        )

    def along(self, along: RobotCourse, starts: Indices, rows: int) -> Array:
        """Positions (W, rows + 1, n) [rad or m] of windows that begin at the states of a motion, in rows `starts`."""
        q, v = (np.ascontiguousarray(x[None, starts]) for x in along.motion[:2])
        out, saturated = np.empty((1, len(starts), rows + 1, q.shape[2])), np.empty(q.shape)
        simulate(  # type: ignore[call-arg]
            starts, rows, self.parts, self.h, along.middle, *map(np.ascontiguousarray, (
                along.bias, along.by_q, along.by_v, along.motion.q, along.motion.v, along.wave, self.commands,
                self.variant, self.on, self.voltage, self.gain, self.numbers,
            )), self.laws, q, v, out, saturated,
        )  # fmt: skip
        return np.asarray(out[0])


class _Loop(_Drives):
    """Closed loop with Pinocchio in every substep."""

    def __init__(
        self, robot: Robot, grid: ServoGrid, motion: Moved, driven: list[int], acting: list[Servo], parts: int
    ) -> None:
        super().__init__(grid, driven, acting, parts)
        self.robot, self.grid, self.motion, self.driven = robot, grid, motion, driven
        self.data = robot.model.createData()
        self.plain = all(is_plain(joint) for joint in list(robot.model.joints)[1:])

    def run(self, restart: int) -> Array:
        """Positions (N, n), with the state set to the measured one every `restart` rows."""
        out, rows = self.grid.q.copy(), len(self.grid)
        q, v = np.empty(len(self.driven)), np.empty(len(self.driven))
        for k in range(rows - 1):
            if k % restart == 0:
                q[:], v[:] = self.motion.q[k, self.driven], self.motion.v[k, self.driven]
                out[k, self.driven] = q
            self._row(k, q, v)
            out[k + 1, self.driven] = q
        return out

    def _row(self, k: int, q: Array, v: Array) -> None:
        """Advance a row in place."""
        motion, j, n = self.motion, self.driven, len(q)
        act, again, b, room = np.empty((4, n)), np.empty((5, n)), np.empty(n), np.empty((n, n + 2))
        known = np.empty(2 * n + 1)
        for s in range(self.parts):
            far = (s + 0.5) / self.parts
            whole, speed, rate = ((1 - far) * x[k] + far * x[k + 1] for x in motion)
            half, step = q + 0.5 * self.h * v, k * self.parts + s
            whole[j], speed[j], rate[j] = half, v, 0.0
            self.act(k, step, half, v, act)
            mass, load = self._dynamics(whole, speed, rate)
            before, known[0] = v.copy(), -1.0
            for _ in range(PASSES):
                kick(v, mass[None], 0, act[0] - load, self.numbers, 0, act, self.h, b, room, known)
                if not limited(
                    v, before, self.numbers, 0, self.laws, half, self.commands, self.variant, step,
                    self.on, self.voltage, k, self.gain, act, again,
                ):  # fmt: skip
                    break
            q[:] = half + 0.5 * self.h * v

    def _dynamics(self, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Mass matrix and torque of the driven joints; those that follow the recording keep its acceleration."""
        robot, j = self.robot, self.driven
        state = robot.drive @ q + robot.rest if self.plain else configuration(robot, q)
        torque = pin.rnea(robot.model, self.data, state, robot.drive @ v, robot.drive @ a) @ robot.drive
        mass = joint_inertia(robot, pin.crba(robot.model, self.data, state))
        return np.ascontiguousarray(mass[np.ix_(j, j)]), np.asarray(torque[j])
