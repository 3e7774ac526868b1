"""Start of a fit: error of the loop as a linear response of the torque of the motion (compliance regression).

Limits of torque start from a scan: short windows are simulated at many of them, with all other numbers fixed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls
from scipy.signal import butter, filtfilt

from ...model import Model
from ...servos import Servo, ServoGrid
from ...types import Array, Mask
from ..plant.course import RobotCourse, bodies_of, copies_of, groups, motion_of, part, recorded_course
from ..plant.grid import commands_at
from ..plant.torque import EFFORT
from .normal import NUDGE, STATE, FitWindows, shoot, state_slopes, window_places, windows_of

DELAYS = tuple(k * 0.005 for k in range(13))  # [s]
SHARES = (0.15, 0.25, 0.35, 0.5, 0.65, 0.8, 0.9)  # quantiles of |error| that are tried as its limit
GAIN_OF_LIMIT = 0.98  # a limit must bring the squares below this share of those without one
CUTOFF, EDGE = 6.0, 0.3  # [Hz] of both sides, [s] left out at the ends
SLIDING = 0.05  # [rad/s] over which friction turns
COLUMNS = 5  # torque, speed, friction, armature, constant
SPREAD = 6.0  # largest ratio of a stiffness to the median of the joints
RATIOS = (0.01, 0.02, 0.035, 0.06, 0.1)  # [s] kd over kp that are tried where the limit acts on the damping, too
LIMITS = tuple(0.95 * 0.78**k for k in range(12))  # of the largest torque, where a limit is tried
BRIEF = 0.2  # [s]: nearly linear
LENGTH = 0.2  # [s] rows that are compared; a start is forgotten within them
ROUNDS = 4  # of Gauss-Newton
FIRST_SHARES = (0.0, 0.1, 0.3, 0.6, 1.0)  # of its step that are tried
BUTTERWORTH = lru_cache(maxsize=8)(butter)
MIN_POSITION_NOISE = 1e-4  # [rad or m] least noise of positions


class _Factors(NamedTuple):
    """The columns of M rows, over their sizes, as an orthogonal and a triangular factor."""

    q: Array  # (M, 5)
    r: Array  # (5, 5)
    size: Array  # (5,) of the columns


class _Line(NamedTuple):
    squares: float  # relative
    ratio: float  # kd over kp inside the limit [s]
    compliance: Array  # (5,) of the columns
    limit: float  # of the error [rad or m]


def start_servos(model: Model, grids: Sequence[ServoGrid], law: str = "effort") -> dict[str, Servo]:
    """Drives to start a fit from, for every joint with commands.

    clip(e - ratio v, limits) = (1/kp) (torque of the motion + damping v + friction sign v + armature a) + constant, by
    non-negative least squares over a grid of delays, limits and, but for `duty`, ratios kd/kp. All damping is `kd`.

    Args:
        model: bodies and laws of the robot.
        grids: recordings, all of the same joints.
        law: one of DRIVE_LAWS.
    """
    courses = [recorded_course(model, grid) for grid in grids]
    joints = [j for j in range(len(grids[0].joints)) if any(grid.driven[j] for grid in grids)]
    lines_of = [_lines(grids, courses, j, (0.0,) if law == "duty" else (0.0, *RATIOS)) for j in joints]
    best = [int(np.argmin([line.squares for line in some])) for some in lines_of]
    lines = [some[k] for some, k in zip(lines_of, best, strict=True)]
    stiffness = 1.0 / np.maximum([line.compliance[0] for line in lines], 1e-5)
    known = stiffness[stiffness < 0.9e5]
    middle = float(np.median(known)) if len(known) else 10.0
    stiffness = np.clip(stiffness, middle / SPREAD, middle * SPREAD)
    most = np.max([np.abs(grid.gain * (grid.command - grid.q)).max(axis=0) for grid in grids], axis=0)
    return {
        grids[0].joints[j]: _servo(law, float(kp), line, DELAYS[k], float(most[j]))
        for j, kp, line, k in zip(joints, stiffness, lines, best, strict=True)
    }


def _servo(law: str, kp: float, line: _Line, delay: float, most: float) -> Servo:
    _, damping, friction, armature, _ = kp * line.compliance
    damping = damping + line.ratio * kp
    scale = kp * most
    limit = kp * line.limit if np.isfinite(line.limit) else np.inf
    return Servo(
        law=law,
        kp=kp,
        kd=max(float(damping), 1e-3 * scale),
        delay=delay,
        effort_limit=limit,
        coulomb_friction=max(float(friction), 1e-3 * scale),
        armature=max(float(armature), 1e-5 * scale),
    )


def _lines(grids: Sequence[ServoGrid], courses: Sequence[RobotCourse], j: int, ratios: Sequence[float]) -> list[_Line]:
    """Line of one joint for each delay: the best with a limit, if the limit helps, else the first one without."""
    sides = [side for grid, along in zip(grids, courses, strict=True) if (side := _side(grid, along, j)) is not None]
    if not sides:
        return [_Line(1.0, 0.0, np.zeros(COLUMNS), np.inf)] * len(DELAYS)
    x = np.concatenate([side.columns for side in sides])
    size = np.linalg.norm(x, axis=0) + 1e-12
    factors = _Factors(*np.linalg.qr(x / size), size)
    out = []
    for delay in DELAYS:
        lines = [line for ratio in ratios for line in _limited(sides, j, delay, ratio, factors)]
        free = next(line for line in lines if not np.isfinite(line.limit))
        best = min((line for line in lines if np.isfinite(line.limit)), key=lambda line: line.squares)
        out.append(free if best.squares > GAIN_OF_LIMIT * free.squares else best)
    return out


def _limited(sides: Sequence[_Side], j: int, delay: float, ratio: float, factors: _Factors) -> list[_Line]:
    """Lines of one joint for each limit of the error."""
    q, r, size = factors
    errors = [side.error(j, delay) - ratio * side.speed for side in sides]
    used = np.abs(np.concatenate([error[side.use] for side, error in zip(sides, errors, strict=True)]))
    limits = np.append(np.quantile(used, SHARES), np.inf)
    clipped = [np.clip(error[:, None], -limits, limits) for error in errors]
    y = np.concatenate([_filtered(e, side.grid.rate)[side.use] for side, e in zip(sides, clipped, strict=True)])
    found = []
    for limit, column in zip(limits, y.T, strict=True):
        inside = q.T @ column
        signed, left = nnls(np.column_stack([r, -r[:, -1]]), inside)  # the constant has either sign
        compliance = np.append(signed[: COLUMNS - 1], signed[COLUMNS - 1] - signed[COLUMNS])
        whole = max(float(column @ column), 1e-30)
        squares = max((whole - float(inside @ inside) + left**2) / whole, 1e-12)
        found.append(_Line(squares, ratio, compliance / size, float(limit)))
    return found


@dataclass(frozen=True, eq=False)
class _Side:
    """One joint in one grid: filtered columns in use (M, 5), and which of its rows (N,) are in use."""

    grid: ServoGrid
    columns: Array
    use: Mask
    speed: Array  # (N,) [rad/s or m/s]

    def error(self, j: int, delay: float) -> Array:
        """Error of the loop (N,) [rad or m] at the nominal gain."""
        command = commands_at(self.grid, j, "velocity", delay, np.inf, 1)[0]
        return np.asarray(self.grid.gain[j] * (command - self.grid.q[:, j]))


def _side(grid: ServoGrid, along: RobotCourse, j: int) -> _Side | None:
    """Columns of one joint in one grid; None if no row is usable."""
    edge = int(EDGE * grid.rate)
    held = (grid.on[:, j] > 0.5).astype(float)
    use = np.asarray(np.convolve(held, np.ones(2 * edge + 1), mode="same") > 2 * edge + 0.5)  # drops the ends, too
    if use.sum() < 10 or len(grid) < 3 * edge:
        return None
    _, v, a = (x[:, j] for x in along.motion)
    columns = np.column_stack([along.torque[:, j], v, np.tanh(v / SLIDING), a, np.ones_like(v)])
    return _Side(grid, _filtered(columns, grid.rate)[use], use, v)


def _filtered(x: Array, rate: float) -> Array:
    b, a = BUTTERWORTH(3, min(2 * CUTOFF / rate, 0.8))
    return np.asarray(filtfilt(b, a, x, axis=0))


def start_limits(
    model: Model, grids: Sequence[ServoGrid], servos: Mapping[str, Servo], top: Mapping[str, float]
) -> dict[str, float]:
    """Limit of each joint in `top` that fits its windows best, of its first share where none helps.

    Args:
        model: bodies and laws of the robot.
        grids: recordings, all of the same joints and one rate.
        servos: drives by joint.
        top: largest torque by joint [N.m or N].
    """
    robot, found = bodies_of(model, grids[0].joints), {}
    acting = [j for j, joint in enumerate(grids[0].joints) if joint in servos]
    for joints in groups(robot, acting):
        names = [grids[0].joints[j] for j in joints]
        if not any(name in top for name in names):
            continue
        drives = [servos[name] for name in names]
        copies = copies_of([drives] * len(LIMITS))
        for i, name in enumerate(names):
            if name in top:
                copies.numbers[:, i, EFFORT] = top[name] * np.array(LIMITS)
        along = [part(recorded_course(model, grid), joints) for grid in grids]
        windows = windows_of(grids, joints, drives, along, window_places(grids, BRIEF))
        q0, v0 = (np.repeat(x[None], len(LIMITS), 0) for x in (windows.q0, windows.v0))
        error = shoot(windows, copies, q0, v0)[0] - windows.measured
        squares = np.nan_to_num(error**2, nan=np.inf).sum(axis=(1, 2)) / windows.inside.sum()
        best = np.argmin(squares, axis=0)
        found.update({name: LIMITS[k] * top[name] for name, k in zip(names, best, strict=True) if name in top})
    return found


def first_state(model: Model, grid: ServoGrid) -> tuple[Array, Array]:
    """Positions (n,) [rad or m] and speeds (n,) [rad/s or m/s] of the first row.

    Smoothed positions have no right speed at the first row: a robot that begins to move there seems to move before.
    Driven joints have the state that a window of the fit would have (section 3 of `servo/README.md`).
    """
    motion, driven = motion_of(grid), [j for j, joint in enumerate(grid.joints) if joint in model.servos]
    q, v = motion.q[0].copy(), motion.v[0].copy()
    servos, n = [model.servos[grid.joints[j]] for j in driven], len(driven)
    rows = min(int(round(LENGTH * grid.rate)), len(grid) - 1)
    windows = windows_of([grid], driven, servos, [part(recorded_course(model, grid), driven)], [(0, 0, rows)])
    smoothed, wide, nudges = np.concatenate([q[driven], v[driven]]), np.repeat(STATE, n), np.repeat(NUDGE, n)
    at, noise = smoothed, np.zeros(n)
    for k in range(ROUNDS):
        found = _positions(windows, servos, at + np.vstack([np.zeros(2 * n), np.diag(nudges)]))
        left = found[0] - windows.measured
        if k == 0:
            noise = np.maximum(np.sqrt(np.mean(left**2, axis=(0, 1))), MIN_POSITION_NOISE)
        slopes = state_slopes((found[1:] - found[0]) / nudges[:, None, None, None], noise)
        step = slopes.inverse[0] @ (slopes.slopes[0].T @ (left / noise).ravel() + (at - smoothed) / wide**2)
        tried = at - np.array(FIRST_SHARES)[:, None] * step
        misfit = np.sum(((_positions(windows, servos, tried) - windows.measured) / noise) ** 2, axis=(1, 2, 3))
        at = tried[np.argmin(misfit + np.sum(((tried - smoothed) / wide) ** 2, axis=1))]
    q[driven], v[driven] = at[:n], at[n:]
    return q, v


def _positions(windows: FitWindows, servos: Sequence[Servo], states: Array) -> Array:
    """Positions (C, 1, T, n) [rad or m] from C states (C, 2n): positions first, then speeds."""
    starts = states[:, None, : len(servos)], states[:, None, len(servos) :]
    return shoot(windows, copies_of([servos] * len(states)), *starts)[0]
