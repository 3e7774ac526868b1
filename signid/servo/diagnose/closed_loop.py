"""Closed loops of one group of coupled joints over short windows: residuals in rad of many drives at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...effects.bodies import add_body, point_inertia
from ...model import Model
from ...robot.dynamics import moved_bodies, own_row
from ...servos import Servo, ServoGrid
from ...types import Array
from ..fit.coordinates import Coordinates, typical
from ..fit.normal import NUDGE, joined_bodies, shoot, windows_of
from ..plant.course import Moved, RobotCourse, bodies_of, copies_of, course, motion_of, part, recorded_course
from ..plant.kernel import LoopBodies

LINEAR = ("mass", "bias", "by_q", "by_v", "wave")  # of the bodies, in the inertial parameters of one
UNITS = (0.1, *(3 * [0.01]), *(6 * [1e-3]))  # [kg, kg.m, kg.m2] steps that the slopes are taken with
MOST_KEPT = 2_000_000  # numbers of a mass matrix along all rows, beyond which slopes take too much memory
MARGIN = 2.0  # [1] a gain may grow by this factor before substeps are too long


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
        starts = [min(int(0.1 * grid.rate), max(len(grid) - self.rows - 1, 0)) for grid in grids]
        spans = [range(first, len(grid) - self.rows, self.rows) for first, grid in zip(starts, grids, strict=True)]
        self.places = [(g, k) for g, span in enumerate(spans) for k in span]  # grid and first row, one after another
        if most is not None and len(self.places) > most:  # spread evenly
            kept = np.unique(np.linspace(0, len(self.places) - 1, most).round().astype(int))
            self.places = [self.places[k] for k in kept]
        courses = [part(recorded_course(model, grid), self.joints) for grid in grids]
        self.sizes = [typical(servo, j, grids, self.motions) for servo, j in zip(servos, joints, strict=True)]
        stiff = [servo.with_(kp=servo.kp * MARGIN) for servo in servos]
        places = [(grid, first, self.rows) for grid, first in self.places]
        self._windows = windows_of(self.grids, self.joints, stiff, courses, places)
        self.starts, self.q0, self.v0 = self._windows.first, self._windows.q0, self._windows.v0
        self.motion = Moved(*(np.concatenate([along.motion[k] for along in courses]) for k in range(3)))
        self.torque = np.concatenate([along.torque for along in courses])  # (R, n) [N.m or N]
        self._bodies: dict[object, LoopBodies] = {None: self._windows.bodies}
        self._slopes: dict[str, list[Array]] = {}  # of LINEAR, by each inertial parameter of a body at the last link

    @property
    def windows(self) -> int:
        """Number of windows."""
        return len(self.starts)

    def bodies(self, body: tuple[float, float, float, float] | None) -> LoopBodies:
        """Bodies along all rows with one at the last link, or without."""
        if body not in self._bodies:
            if len(self._bodies) > 24:
                self._bodies = {None: self._bodies[None]}
            self._bodies[body] = self._with_body(body)
        return self._bodies[body]

    def _along(self, added: Sequence[float]) -> list[RobotCourse]:
        """Course along each recording with up to ten inertial parameters added to the last link."""
        model = self.robot.model.copy()
        add_body(model, self.leaf_body, added)
        robot = replace(self.robot, model=model)
        return [part(course(robot, motion), self.joints) for motion in self.motions]

    def _with_body(self, body: tuple[float, float, float, float] | None) -> LoopBodies:
        """Bodies with a point mass; torques are linear in its inertial parameters, so ten courses give all others."""
        assert body is not None
        numbers = [*body, *point_inertia(body[0], body[1:])]
        base = self._bodies[None]
        if base.mass.size > MOST_KEPT:
            return joined_bodies(self._along(numbers))
        if not self._slopes:
            units = np.diag(UNITS).tolist()
            self._slopes = {key: [] for key in LINEAR}
            for unit, size in zip(units, UNITS, strict=True):
                moved = joined_bodies(self._along(unit))
                for key, slopes in self._slopes.items():
                    slopes.append((getattr(moved, key) - getattr(base, key)) / size)
        sums = {key: np.tensordot(numbers, slopes, axes=1) for key, slopes in self._slopes.items()}
        return base._replace(**{key: getattr(base, key) + x for key, x in sums.items()})

    def residuals(self, points: Sequence[Coordinates]) -> Array:
        """Simulated minus measured positions (C, W, T, n) [rad or m] from the measured states."""
        return np.asarray(self._roll(points, self.q0, self.v0) - self._windows.measured)

    def state_columns(self, point: Coordinates) -> Array:
        """Derivatives (2n, W, T, n) by the position and the speed of each joint at the start of a window."""
        n, out = len(self.joints), []
        base = self._roll([point], self.q0, self.v0)[0]
        for kind, size in enumerate(NUDGE):
            for j in range(n):
                q0, v0 = self.q0.copy(), self.v0.copy()
                (q0, v0)[kind][:, j] += size
                out.append((self._roll([point], q0, v0)[0] - base) / size)
        return np.array(out)

    def _roll(self, points: Sequence[Coordinates], q0: Array, v0: Array) -> Array:
        """Positions (C, W, T, n) of drives and bodies at C points, in one batch for each body."""
        out = np.empty((len(points), self.windows, self.rows + 1, len(self.joints)))
        groups: dict[tuple[float, float, float, float] | None, list[int]] = {}
        for c, point in enumerate(points):
            groups.setdefault(point.body, []).append(c)
        for body, chosen in groups.items():
            q, v = (np.repeat(x[None], len(chosen), 0) for x in (q0, v0))
            copies = copies_of([points[c].servos for c in chosen])
            out[chosen] = shoot(self._windows, copies, q, v, self.bodies(body))[0]
        return out
