"""Gauss-Newton fits of several hypotheses at once: their copies of the closed loop advance in one batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...effects.drive import Reach
from ...servos import Servo
from ...types import Array
from .closed_loop import ClosedLoop, Point, leave_states, reduced_squares
from .coordinates import Free, Scale, coordinate, difference, longest, with_coordinates

DAMPINGS = (0.0, 0.3, 3.0, 30.0)  # [1] of Levenberg and Marquardt, tried together
PRIOR = {"first_moment_x": 0.1, "first_moment_y": 0.1, "first_moment_z": 0.1}  # std of the body's centre [m] per mass


@dataclass(frozen=True, eq=False)
class Attempt:
    """A hypothesis at some values: W windows, n joints of the group."""

    point: Point
    frees: list[Free]
    squares: Array  # (W, n) sums of squares without the initial states [rad2 or m2]
    covariance: Array | None = None  # (P, P) [any] of the coordinates

    def cost(self, sigma: Array) -> float:
        """Weighted sum of squares. sigma: (n,) [rad or m]."""
        return float(np.sum(self.squares / sigma**2)) + _prior(self.point, self.frees)


@dataclass(frozen=True, eq=False)
class Setting:
    """Windows, initial states and weights that the fits share."""

    loop: ClosedLoop
    states: Array  # (2n, W, T, n) [1]
    sigma: Array  # (n,) [rad or m]
    scales: tuple[Scale, ...]  # n

    def evaluate(self, points: Sequence[Point]) -> Array:
        """Sums of squares (C, W, n) after the best initial states."""
        return reduced_squares(self.loop.residuals(points), self.states, self.sigma)

    def remaining(self, points: Sequence[Point]) -> Array:
        """Residuals (C, W, T, n) after the best initial states."""
        return leave_states(self.loop.residuals(points), self.states, self.sigma)

    def weighted(self, sigma: Array) -> Setting:
        """The same with other weights. sigma: (n,) [rad or m]."""
        return replace(self, sigma=sigma)


def refine(setting: Setting, trials: Sequence[Attempt], iterations: int = 6, tolerance: float = 1e-4) -> list[Attempt]:
    """Fit each hypothesis from its values; the covariance is that of the last step."""
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


def _step(setting: Setting, trials: Sequence[Attempt]) -> list[Attempt]:
    points: list[Point] = []
    for trial in trials:
        points.append(trial.point)
        x, h = _coordinates(setting, trial)
        for sign in (1.0, -1.0):
            points += [with_coordinates(trial.point, trial.frees, x + sign * e) for e in np.diag(h)]
    remaining = setting.remaining(points) / setting.sigma
    proposals: list[Point] = []
    covariances, place = [], 0
    for trial in trials:
        n = len(trial.frees)
        block = remaining[place : place + 1 + 2 * n]
        place += 1 + 2 * n
        steps, covariance = _proposals(setting, trial, block)
        covariances.append(covariance)
        proposals += steps
    squares = setting.evaluate(proposals)
    out = []
    for k, (trial, covariance) in enumerate(zip(trials, covariances, strict=True)):
        rows = range(k * len(DAMPINGS), (k + 1) * len(DAMPINGS))
        offered = [Attempt(proposals[i], trial.frees, squares[i], covariance) for i in rows]
        out.append(min([replace(trial, covariance=covariance), *offered], key=lambda t: t.cost(setting.sigma)))
    return out


def _proposals(setting: Setting, trial: Attempt, block: Array) -> tuple[list[Point], Array]:
    """Points of a Levenberg-Marquardt step with several dampings, and the covariance clustered by window."""
    x, h = _coordinates(setting, trial)
    n, r = len(x), block[0].reshape(block.shape[1], -1)
    jacobian = ((block[1 : 1 + n] - block[1 + n :]) / (2 * h[:, None, None, None])).reshape(n, block.shape[1], -1)
    scores = np.einsum("pwt,wt->wp", jacobian, r)
    hessian = np.einsum("pwt,rwt->pr", jacobian, jacobian)
    gradient = scores.sum(axis=0)
    weight, pull = _prior_terms(trial, x)
    hessian, gradient = hessian + np.diag(weight), gradient + pull
    most = np.array([longest(f, _servo(trial, f), setting.scales[max(f.joint, 0)]) for f in trial.frees])
    points = []
    size = np.diag(hessian) + 1e-12 * np.max(np.diag(hessian), initial=1e-300) + 1e-300
    for damping in DAMPINGS:
        step = -np.linalg.lstsq(hessian + np.diag(damping * size + 1e-12 * size), gradient, rcond=None)[0]
        points.append(with_coordinates(trial.point, trial.frees, x + np.clip(step, -most, most)))
    bread = np.linalg.pinv(hessian, hermitian=True)
    windows = len(scores)
    robust = bread @ (scores.T @ scores) @ bread * windows / max(windows - n, 1)
    noise = float(np.sum(r**2)) / max(r.size - n, 1)
    larger = np.sqrt(np.maximum(noise * np.diag(bread) / np.maximum(np.diag(robust), 1e-300), 1.0))
    return points, np.asarray(robust * np.outer(larger, larger))


def _coordinates(setting: Setting, trial: Attempt) -> tuple[Array, Array]:
    x = np.array([coordinate(trial.point, free) for free in trial.frees])
    h = np.array([difference(f, _servo(trial, f), setting.scales[max(f.joint, 0)]) for f in trial.frees])
    return x, h


def _servo(trial: Attempt, free: Free) -> Servo | None:
    return None if free.joint < 0 else trial.point.servos[free.joint]


def _prior(point: Point, frees: Sequence[Free]) -> float:
    if point.body is None:
        return 0.0
    m = max(point.body[0], 1e-4)
    return float(sum((x / (m * 0.1)) ** 2 for x in point.body[1:])) if any(f.joint < 0 for f in frees) else 0.0


def _prior_terms(trial: Attempt, x: Array) -> tuple[Array, Array]:
    weight, pull = np.zeros(len(x)), np.zeros(len(x))
    for k, free in enumerate(trial.frees):
        if free.number in PRIOR and trial.point.body is not None:
            weight[k] = (max(trial.point.body[0], 1e-4) * PRIOR[free.number]) ** -2.0
            pull[k] = weight[k] * x[k]
    return weight, pull


def reach(setting: Setting, point: Point, j: int) -> Reach:
    """Sizes at a joint."""
    loop, scale = setting.loop, setting.scales[j]
    a = loop.motion.a[:, j]
    return Reach(scale.effort, scale.speed, _error(loop, j), float(np.sqrt(np.mean(a**2))))


def setting_of(loop: ClosedLoop, point: Point, floor: Array) -> Setting:
    """Setting of windows with the initial states and scales at a point. floor: (n,) [rad or m]."""
    scales = []
    for j, servo in enumerate(point.servos):
        torque = loop.torque[:, j] + servo.armature * loop.motion.a[:, j] + servo.damping * loop.motion.v[:, j]
        effort = float(np.max(np.abs(torque)) + servo.coulomb_friction)
        scales.append(Scale(effort, float(np.max(np.abs(loop.motion.v[:, j]))), loop.grids[0].step))
    return Setting(loop, loop.state_columns(point), floor * 2.0, tuple(scales))


def _error(loop: ClosedLoop, j: int) -> float:
    column = loop.joints[j]
    return float(max(np.max(np.abs(g.command[:, column] - g.q[:, column])) for g in loop.grids))
