"""Gauss-Newton fits of several hypotheses at once: their copies of the closed loop advance in one batch.

Coordinates, step and covariance are those of the identification (`servo.fit`). All hypotheses share the influence of
the initial states at the last simulation, and the weights of the joints; each tries several dampings at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...effects.drive import Reach
from ...types import Array
from ..fit.coordinates import Coordinates, Slot
from ..fit.intervals import covariance
from ..fit.normal import Normal, StateSlopes, derivatives, nearby, reduced, state_slopes
from ..fit.solve import damped
from .closed_loop import ClosedLoop

DAMPINGS = (1e-9, 0.3, 3.0, 30.0)  # [1] of Levenberg and Marquardt, tried together
WIDE = 2.0  # differences over those of an identification: the cost is rougher far from the optimum


@dataclass(frozen=True, eq=False)
class Attempt:
    """A hypothesis at some values: W windows, n joints of the group."""

    where: Coordinates  # at the values
    squares: Array  # (W, n) sums of squares without the initial states [rad2 or m2]

    def cost(self, sigma: Array) -> float:
        """Weighted sum of squares. sigma: (n,) [rad or m]."""
        return float(np.sum(self.squares / sigma**2)) + self.where.prior_cost(self.where.values)


@dataclass(frozen=True, eq=False)
class Setting:
    """Windows, initial states and weights that the fits share."""

    loop: ClosedLoop
    states: Array  # (2n, W, T, n) [1]
    sigma: Array  # (n,) [rad or m]

    @cached_property
    def slopes(self) -> StateSlopes:
        """Influence of the initial states."""
        return state_slopes(self.states, self.sigma)

    def evaluate(self, points: Sequence[Coordinates]) -> Array:
        """Sums of squares (C, W, n) after the best initial states."""
        return np.asarray(np.sum(self.remaining(points) ** 2, axis=2))

    def remaining(self, points: Sequence[Coordinates]) -> Array:
        """Residuals (C, W, T, n) after the best initial states."""
        return self.slopes.leave(self.loop.residuals(points) / self.sigma) * self.sigma

    def weighted(self, sigma: Array) -> Setting:
        """The same with other weights. sigma: (n,) [rad or m]."""
        return replace(self, sigma=sigma)

    def slot(self, joint: int, number: str) -> Slot:
        """A free number of a joint of the group, or of the body at the last link (joint -1)."""
        if joint < 0:
            whole = sum(body.mass for body in list(self.loop.robot.model.inertias)[1:])
            return Slot(joint, number, 0.1 * whole * (1.0 if number == "mass" else 0.1))
        return Slot(joint, number, self.loop.sizes[joint].get(number, 1.0))

    def reach(self, point: Coordinates, j: int) -> Reach:
        """Sizes at a joint."""
        loop, servo = self.loop, point.servos[j]
        v, a = loop.motion.v[:, j], loop.motion.a[:, j]
        torque = loop.torque[:, j] + servo.armature * a + servo.damping * v
        effort = float(np.max(np.abs(torque)) + servo.coulomb_friction)
        column = loop.joints[j]
        error = max(float(np.max(np.abs(g.command[:, column] - g.q[:, column]))) for g in loop.grids)
        travel = float(np.ptp(loop.motion.q[:, j]))
        return Reach(effort, float(np.max(np.abs(v))), error, float(np.sqrt(np.mean(a**2))), travel)


def setting_of(loop: ClosedLoop, point: Coordinates, floor: Array) -> Setting:
    """Setting of windows with the initial states at a point. floor: (n,) [rad or m]."""
    return Setting(loop, loop.state_columns(point), floor * 2.0)


def refine(setting: Setting, trials: Sequence[Attempt], iterations: int = 6, tolerance: float = 1e-4) -> list[Attempt]:
    """Fit each hypothesis from its values."""
    trials, active = list(trials), list(range(len(trials)))
    for _ in range(iterations):
        if not active:
            break
        moved = _step(setting, [trials[k] for k in active])
        gains = [
            1 - new.cost(setting.sigma) / trials[k].cost(setting.sigma) for k, new in zip(active, moved, strict=True)
        ]
        for k, new in zip(active, moved, strict=True):
            trials[k] = new
        active = [k for k, gain in zip(active, gains, strict=True) if gain > tolerance]
    return trials


def information(setting: Setting, where: Coordinates) -> Array:
    """Information (P, P) [inverse products of SERVO_UNITS] of the free numbers, without the initial states."""
    return _normals(setting, [where])[0].information


def spread(setting: Setting, trial: Attempt) -> Array:
    """Covariance (P, P) [products of SERVO_UNITS] of the free numbers."""
    where = trial.where
    (at,) = _normals(setting, [where])
    weight = where.prior(where.values)[0] / where.slope(where.values) ** 2
    return covariance(at.information + np.diag(weight), at.scores)


def _step(setting: Setting, trials: Sequence[Attempt]) -> list[Attempt]:
    """The best of several dampings for each hypothesis, or its values before."""
    normals = _normals(setting, [trial.where for trial in trials])
    points = [
        trial.where.at(damped(trial.where, at, trial.where.values, damping))
        for trial, at in zip(trials, normals, strict=True)
        for damping in DAMPINGS
    ]
    moved = [Attempt(point, squares) for point, squares in zip(points, setting.evaluate(points), strict=True)]
    n = len(DAMPINGS)
    return [
        min([trial, *moved[n * k : n * (k + 1)]], key=lambda t: t.cost(setting.sigma)) for k, trial in enumerate(trials)
    ]


def _normals(setting: Setting, wheres: Sequence[Coordinates]) -> list[Normal]:
    """Normal equations of several hypotheses, simulated in one batch."""
    each = [nearby(where, where.values, WIDE, central=True) for where in wheres]
    points = [where.at(values) for where, one in zip(wheres, each, strict=True) for values in one.values]
    left, out, place = setting.loop.residuals(points) / setting.sigma, list[Normal](), 0
    for where, one in zip(wheres, each, strict=True):
        block = left[place : place + len(one.values)]
        place += len(one.values)
        out.append(reduced(derivatives(block, where, one), block[0], setting.slopes))
    return out
