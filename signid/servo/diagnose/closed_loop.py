"""Closed loops of one group of coupled joints over short windows: residuals in rad of many drives at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...effects.bodies import add_body, point_inertia
from ...model import Model
from ...robot.dynamics import moved_bodies, own_row
from ...servos import DRIVE_LAWS, Servo, ServoGrid
from ...types import Array, Robot
from ..fit.normal import NUDGE, STATE
from ..plant.commands import commands_at
from ..plant.course import Moved, RobotCourse as Course, bodies_of, course, motion_of, part
from ..plant.kernel import numbers, simulate
from ..plant.substeps import substeps

LINEAR = ("mass", "bias", "by_q", "by_v", "wave", "torque")  # of a course, in the inertial parameters of a body
UNITS = (0.1, *(3 * [0.01]), *(6 * [1e-3]))  # [kg, kg.m, kg.m2] steps that the slopes are taken with
MOST_KEPT = 2_000_000  # numbers of a mass matrix along all rows, beyond which slopes take too much memory
MARGIN = 2.0  # [1] a gain may grow by this factor before substeps are too long


class Point(NamedTuple):
    """Drives of a group, and a body at its last link: mass [kg] and first moment [kg.m]."""

    servos: tuple[Servo, ...]  # n
    body: tuple[float, float, float, float] | None = None


@dataclass(frozen=True, eq=False)
class GroupCourse:
    """Courses of a group over all recordings, one after another: R rows."""

    mass: Array  # (R, n, n) [kg.m2 or kg]
    bias: Array  # (R, n) [N.m or N]
    by_q: Array  # (R, n, n) [N.m/rad]
    by_v: Array  # (R, n, n) [N.m.s/rad]
    wave: Array  # (n, 2) [N.m] torque of the sine and the cosine of the position
    motion: Moved
    torque: Array  # (R, n) [N.m or N]


class ClosedLoop:
    """Windows of T = rows + 1 positions of n joints; W windows of all recordings."""

    def __init__(
        self,
        model: Model,
        grids: Sequence[ServoGrid],
        joints: Sequence[int],
        servos: Sequence[Servo],
        window: float,
        most: int | None = None,
    ) -> None:
        self.model, self.grids, self.joints = model, list(grids), list(joints)
        self.names = tuple(grids[0].joints[j] for j in joints)
        self.robot = bodies_of(model, grids[0].joints)
        moves = moved_bodies(self.robot)[self.joints].sum(axis=1)
        self.leaf = int(len(moves) - 1 - np.argmin(moves[::-1]))  # joint of the group that moves the fewest bodies
        self.leaf_body = own_row(self.robot, self.joints[self.leaf]) + 1
        self.motions = [motion_of(grid) for grid in grids]
        self.rows = max(int(round(window * grids[0].rate)), 3)
        self.places = _thinned(_starts(grids, self.rows), most)
        offset = np.cumsum([0, *[len(grid) for grid in grids]])
        self.starts = np.array([offset[g] + k for g, k in self.places], np.int64)
        self.column = {
            key: np.vstack([getattr(g, key)[:, self.joints] for g in grids]) for key in ("q", "on", "voltage")
        }
        self.gains = np.array([grids[g].gain[self.joints] for g, _ in self.places])  # (W, n)
        self._courses: dict[object, GroupCourse] = {}
        self._slopes: dict[str, list[Array]] = {}  # of LINEAR, by each inertial parameter of a body at the last link
        self._commands: dict[tuple[object, ...], Array] = {}
        inertia = np.einsum("tii->ti", self.along(None).mass).min(axis=0)
        stiff = [servo.with_(kp=servo.kp * MARGIN) for servo in servos]
        self.parts = substeps(grids[0].step, stiff, inertia)
        span = self.starts[:, None] + np.arange(self.rows + 1)
        self.measured = self.column["q"][span]  # (W, T, n)
        self.driven = self.column["on"][span] > 0.5  # (W, T, n)
        motion = self.along(None).motion
        self.q0, self.v0 = motion.q[self.starts], motion.v[self.starts]

    @property
    def windows(self) -> int:
        """Number of windows."""
        return len(self.starts)

    def along(self, body: tuple[float, float, float, float] | None) -> GroupCourse:
        """Courses with a body at the last link, or without."""
        if body not in self._courses:
            if len(self._courses) > 24:
                self._courses = {None: self._courses[None]}
            self._courses[body] = self._course([]) if body is None else self._with_body(body)
        return self._courses[body]

    def _course(self, added: Sequence[float]) -> GroupCourse:
        """Courses with up to ten inertial parameters added to the last link."""
        robot = carrying(self.robot, self.leaf_body, added) if added else self.robot
        return _joined([part(course(robot, motion), self.joints) for motion in self.motions])

    def _with_body(self, body: tuple[float, float, float, float]) -> GroupCourse:
        """Courses with a point mass; torques are linear in its inertial parameters, so ten courses give all others."""
        numbers = [*body, *point_inertia(body[0], body[1:])]
        base = self.along(None)
        if base.mass.size > MOST_KEPT:
            return self._course(numbers)
        if not self._slopes:
            units = np.diag(UNITS).tolist()
            self._slopes = {key: [] for key in LINEAR}
            for unit, size in zip(units, UNITS, strict=True):
                moved = self._course(unit)
                for key, slopes in self._slopes.items():
                    slopes.append((getattr(moved, key) - getattr(base, key)) / size)
        sums = {key: np.tensordot(numbers, slopes, axes=1) for key, slopes in self._slopes.items()}
        return replace(base, **{key: getattr(base, key) + x for key, x in sums.items()})

    def residuals(self, points: Sequence[Point]) -> Array:
        """Simulated minus measured positions (C, W, T, n) [rad or m] from the measured states."""
        return np.asarray(self._roll(points, self.q0, self.v0)[0] - self.measured)

    def state_columns(self, point: Point) -> Array:
        """Derivatives (2n, W, T, n) by the position and the speed of each joint at the start of a window."""
        n, out = len(self.joints), []
        base = self._roll([point], self.q0, self.v0)[0][0]
        for kind, size in enumerate(NUDGE):
            for j in range(n):
                q0, v0 = self.q0.copy(), self.v0.copy()
                (q0, v0)[kind][:, j] += size
                out.append((self._roll([point], q0, v0)[0][0] - base) / size)
        return np.array(out)

    def saturated(self, point: Point) -> Array:
        """Share of substeps at the limit, (n,) [1]."""
        return np.asarray(self._roll([point], self.q0, self.v0)[1][0].mean(axis=0) / (self.rows * self.parts))

    def _roll(self, points: Sequence[Point], q0: Array, v0: Array) -> tuple[Array, Array]:
        out = np.empty((len(points), self.windows, self.rows + 1, len(self.joints)))
        saturated = np.zeros((len(points), self.windows, len(self.joints)))
        groups: dict[tuple[object, ...], list[int]] = {}
        for c, point in enumerate(points):
            groups.setdefault((point.body, tuple(s.law for s in point.servos)), []).append(c)
        for chosen in groups.values():
            out[chosen], saturated[chosen] = self._same_laws([points[c] for c in chosen], q0, v0)
        return out, saturated

    def _same_laws(self, points: Sequence[Point], q0: Array, v0: Array) -> tuple[Array, Array]:
        at, copies, n = self.along(points[0].body), len(points), len(self.joints)
        variants: dict[tuple[object, ...], int] = {}
        variant = np.empty((copies, n), np.int64)
        for c, point in enumerate(points):
            for i, servo in enumerate(point.servos):
                key = (i, servo.kd_on, servo.delay, servo.profile_speed)
                variant[c, i] = variants.setdefault(key, len(variants))
        commands = np.stack([self._command(key) for key in variants], axis=1)
        out = np.empty((copies, self.windows, self.rows + 1, n))
        saturated = np.zeros((copies, self.windows, n))
        kinds = np.array([[numbers(servo) for servo in point.servos] for point in points])
        laws = np.array([DRIVE_LAWS.index(servo.law) for servo in points[0].servos])
        starts = [np.broadcast_to(x, (copies, *x.shape)).copy() for x in (q0, v0)]
        for gain in np.unique(self.gains, axis=0):
            at_gain = np.all(self.gains == gain, axis=1)
            some = [np.ascontiguousarray(x[:, at_gain]) for x in (*starts, out, saturated)]
            simulate(
                self.starts[at_gain], self.rows, self.parts, self.grids[0].step / self.parts,
                at.mass, at.bias, at.by_q, at.by_v, at.motion.q, at.motion.v, at.wave,
                np.ascontiguousarray(commands), variant, self.column["on"], self.column["voltage"], gain,
                kinds, laws, *some,
            )  # fmt: skip
            out[:, at_gain], saturated[:, at_gain] = some[2:]
        return out, saturated

    def _command(self, key: tuple[object, ...]) -> Array:
        if key not in self._commands:
            if len(self._commands) > 400:
                self._commands.clear()
            i, kd_on, delay, profile = key
            j = self.joints[int(i)]  # type: ignore[call-overload]
            each = [commands_at(grid, j, kd_on, delay, profile, self.parts) for grid in self.grids]  # type: ignore[arg-type]
            self._commands[key] = np.concatenate(each, axis=1)
        return self._commands[key]


def carrying(robot: Robot, index: int, added: Sequence[float]) -> Robot:
    """Robot with up to ten inertial parameters added to a body of its model, in Pinocchio's order."""
    model = robot.model.copy()
    add_body(model, index, added)
    return replace(robot, model=model)


def reduced_squares(residual: Array, states: Array, sigma: Array) -> Array:
    """Sum of squares (C, W, n) after the best initial states.

    residual: (C, W, T, n) [rad or m]; states: (2n, W, T, n) [1]; sigma: (n,) [rad or m].
    """
    return np.asarray(np.sum(leave_states(residual, states, sigma) ** 2, axis=2))


def leave_states(residual: Array, states: Array, sigma: Array) -> Array:
    """Residuals (C, W, T, n) after the best initial states of each window.

    residual: (C, W, T, n) [rad or m]; states: (2n, W, T, n) [1]; sigma: (n,) [rad or m].
    """
    n, (copies, windows, rows, _) = states.shape[-1], residual.shape
    b = (states / sigma).transpose(1, 2, 3, 0).reshape(windows, -1, 2 * n)
    prior = np.diag(np.r_[np.full(n, STATE[0] ** -2.0), np.full(n, STATE[1] ** -2.0)])
    inverse = np.linalg.inv(np.einsum("wts,wtu->wsu", b, b) + prior)
    z = (residual / sigma).reshape(copies, windows, -1)
    d = -np.einsum("wsu,wtu,cwt->cws", inverse, b, z, optimize=True)
    moved = np.einsum("swtn,cws->cwtn", states, d, optimize=True)
    return np.asarray(residual + moved.reshape(copies, windows, rows, n))


def _starts(grids: Sequence[ServoGrid], rows: int) -> list[tuple[int, int]]:
    """Windows (grid, first row), one after another."""
    first = [min(int(0.1 * grid.rate), max(len(grid) - rows - 1, 0)) for grid in grids]
    return [(g, k) for g, grid in enumerate(grids) for k in range(first[g], len(grid) - rows, rows)]


def _thinned(places: list[tuple[int, int]], most: int | None) -> list[tuple[int, int]]:
    if most is None or len(places) <= most:
        return places
    return [places[k] for k in np.unique(np.linspace(0, len(places) - 1, most).round().astype(int))]


def _joined(parts: Sequence[Course]) -> GroupCourse:
    """One course of all recordings; mass in the middle of each row."""
    mass = np.concatenate([x.middle for x in parts])
    motion = Moved(*(np.concatenate([getattr(x.motion, key) for x in parts]) for key in ("q", "v", "a")))
    bias, by_q, by_v, torque = (
        np.concatenate([getattr(x, k) for x in parts]) for k in ("bias", "by_q", "by_v", "torque")
    )
    return GroupCourse(mass, bias, by_q, by_v, parts[0].wave, motion, torque)
