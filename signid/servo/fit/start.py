"""Start of a fit: error of the loop as a linear response of the torque of the motion (compliance regression)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear
from scipy.signal import butter, filtfilt

from ...model import Model
from ...servos import Servo, ServoGrid
from ...types import Array, Mask
from ..plant.commands import commands_at
from ..plant.course import RobotCourse, bodies_of, course, motion_of

DELAYS = tuple(k * 0.005 for k in range(13))  # [s]
SHARES = (0.15, 0.25, 0.35, 0.5, 0.65, 0.8, 0.9)  # quantiles of |error| that are tried as its limit
GAIN_OF_LIMIT = 0.98  # a limit must bring the squares below this share of those without one
CUTOFF, EDGE = 6.0, 0.3  # [Hz] of both sides, [s] left out at the ends
SLIDING = 0.05  # [rad/s] over which friction turns
SPREAD = 6.0  # largest ratio of a stiffness to the median of the joints


class _Line(NamedTuple):
    squares: float  # relative
    compliance: Array  # (5,) torque, speed, friction, armature, constant
    limit: float  # of the error [rad or m]


def start_servos(model: Model, grids: Sequence[ServoGrid], law: str = "effort") -> dict[str, Servo]:
    """Drives to start a fit from, for every joint with commands.

    clip(e, limits) = (1/kp) (torque of the motion + damping v + friction sign v + armature a) + constant, by
    non-negative least squares over a grid of delays and limits. Damping is put into `kd`.

    Args:
        model: bodies and laws of the robot.
        grids: recordings, all of the same joints.
        law: one of DRIVE_LAWS.
    """
    robot = bodies_of(model, grids[0].joints)
    courses = [course(robot, motion_of(grid)) for grid in grids]
    joints = [j for j in range(len(grids[0].joints)) if any(grid.driven[j] for grid in grids)]
    table = [[_line(grids, courses, j, delay) for j in joints] for delay in DELAYS]
    best = int(np.argmin([sum(np.log(line.squares) for line in row) for row in table]))
    lines = table[best]
    stiffness = 1.0 / np.maximum([line.compliance[0] for line in lines], 1e-5)
    known = stiffness[stiffness < 0.9e5]
    middle = float(np.median(known)) if len(known) else 10.0
    stiffness = np.clip(stiffness, middle / SPREAD, middle * SPREAD)
    return {
        grids[0].joints[j]: _servo(law, float(kp), line, DELAYS[best], _most_error(grids, j))
        for j, kp, line in zip(joints, stiffness, lines, strict=True)
    }


def _servo(law: str, kp: float, line: _Line, delay: float, most: float) -> Servo:
    _, damping, friction, armature, _ = kp * line.compliance
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


def _most_error(grids: Sequence[ServoGrid], j: int) -> float:
    return max(float(np.abs(grid.gain[j] * (grid.command - grid.q)[:, j]).max()) for grid in grids)


def _line(grids: Sequence[ServoGrid], courses: Sequence[RobotCourse], j: int, delay: float) -> _Line:
    """Best line of one joint over the limits of the error."""
    sides = [side for pair in zip(grids, courses, strict=True) if (side := _sides(*pair, j, delay)) is not None]
    if not sides:
        return _Line(1.0, np.zeros(5), np.inf)
    x = np.concatenate([side[0] for side in sides])
    error = np.concatenate([side[1][side[2]] for side in sides])
    size = np.linalg.norm(x, axis=0) + 1e-12
    best = None
    for share in (*SHARES, 1.0):
        limit = float(np.quantile(np.abs(error), share)) if share < 1 else np.inf
        y = np.concatenate([_filtered(np.clip(e, -limit, limit), rate)[use] for _, e, use, rate in sides])
        fit = lsq_linear(x / size, y, bounds=([0.0] * 4 + [-np.inf], np.inf))
        squares = max(2 * fit.cost / max(float(y @ y), 1e-30), 1e-12)
        if best is None or squares < best.squares:
            best = _Line(squares, fit.x / size, limit)
        if share == 1.0 and best.squares > GAIN_OF_LIMIT * squares:
            best = _Line(squares, fit.x / size, np.inf)
    assert best is not None
    return best


def _sides(grid: ServoGrid, along: RobotCourse, j: int, delay: float) -> tuple[Array, Array, Mask, float] | None:
    """Columns (rows, 5), error (N,), rows in use (N,) and the rate of one grid; None if no row is usable."""
    edge = int(EDGE * grid.rate)
    held = (grid.on[:, j] > 0.5).astype(float)
    use = np.asarray(np.convolve(held, np.ones(2 * edge + 1), mode="same") > 2 * edge + 0.5)  # drops the ends, too
    if use.sum() < 10 or len(grid) < 3 * edge:
        return None
    q, v, a = (x[:, j] for x in along.motion)
    command = commands_at(grid, j, "velocity", delay, np.inf, 1)[0]
    columns = along.torque[:, j], v, np.tanh(v / SLIDING), a, np.ones_like(v)
    x = np.column_stack([_filtered(column, grid.rate) for column in columns])[use]
    return x, grid.gain[j] * (command - q), use, grid.rate


def _filtered(x: Array, rate: float) -> Array:
    b, a = butter(3, min(2 * CUTOFF / rate, 0.8))
    return np.asarray(filtfilt(b, a, x))
