"""Evidence of torques and positions for one of two clocks of the same rows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...robot import configuration
from ...robot.dynamics import body_regressor
from ...types import Array, Robot

WINDOW, SECONDS = 11, 0.08  # length of the local polynomials: at least both [rows], [s]
DEGREE, TORQUE_DEGREE = 4, 2
BLOCKS, FEWEST = 20, 4  # most blocks that are compared; windows of a block
RANK = 1e-6  # [1] singular values below are zero, relative to the largest
CLEAR_TORQUE, CLEAR_POSITION = (0.02, 4.0), (0.05, 5.0)  # mean log ratio of rms [1] and standard errors that decide
ALONE = 2.0  # factor on both for positions without torques


class TimedRows(NamedTuple):
    """TimedRows of one stretch of n joints."""

    times: tuple[Array, Array]  # (N,) each [s] by either clock
    q: Array  # (N, n) [rad or m]
    tau: Array  # (N, n) [N.m or N], NaN for joints without torque or sign


class _Comparison(NamedTuple):
    """Ratio of two residuals by blocks: the first over the second."""

    mean: float  # mean log of the rms ratio [1]
    errors: float  # its distance from 0 [standard errors]

    def clear(self, limits: tuple[float, float]) -> bool:
        """Whether the ratio differs from 1."""
        return abs(self.mean) > limits[0] and abs(self.errors) > limits[1]


def second_is_better(robot: Robot | None, stretches: list[TimedRows], period: float) -> bool:
    """Whether the second clock of rows fits better than the first one.

    Torques decide where they are clear: the residual of a least-squares fit of the rigid-body regressor and friction on
    positions, velocities and accelerations by local polynomials. These windows of rows are the same for both clocks, so
    the band is. Otherwise the residuals of the polynomials decide, that is the roughness of the positions. The ratios
    of blocks must agree; else the first clock stays. Positions alone are no proof: rows that a logger lost without a
    trace in their number look smooth on an even clock, and torques do not fit them.

    Source: Savitzky, Golay, Analytical Chemistry 36(8), 1964 (derivatives by local polynomials).
    """
    positions = _compare(*(_roughness(stretches, clock) for clock in (0, 1)))
    torque = None
    if robot is not None and any(np.isfinite(rows.tau).any() for rows in stretches):
        torque = _compare(*(_misfit(robot, stretches, clock, period) for clock in (0, 1)))
        if torque is not None and torque.clear(CLEAR_TORQUE):
            return torque.mean > 0
    factor = 1.0 if torque is not None else ALONE
    limits = factor * CLEAR_POSITION[0], factor * CLEAR_POSITION[1]
    return positions is not None and positions.clear(limits) and positions.mean > 0


def _compare(first: Array, second: Array) -> _Comparison | None:
    """Compare squared residuals (W, n) of two clocks; None if there are too few windows, or no residuals."""
    blocks = min(BLOCKS, len(first) // FEWEST)
    if blocks < 5 or not first.shape[1]:
        return None
    pairs = zip(np.array_split(first, blocks), np.array_split(second, blocks), strict=True)
    sums = np.array([(a.sum(axis=0), b.sum(axis=0)) for a, b in pairs])  # (blocks, 2, n)
    least = 1e-12 * sums.mean(axis=(0, 1)) + np.finfo(float).tiny
    ratio = 0.5 * np.log((sums[:, 0] + least) / (sums[:, 1] + least)).mean(axis=1)
    error = ratio.std(ddof=1) / np.sqrt(blocks)
    mean = float(ratio.mean())
    return _Comparison(mean, mean / max(float(error), 1e-12))


def _roughness(stretches: list[TimedRows], clock: int) -> Array:
    """Squared residuals (W, n) of the positions about local polynomials, of joints that move."""
    found = [_polynomials(rows.times[clock], rows.q, WINDOW, WINDOW, DEGREE)[1] for rows in stretches]
    squares = np.concatenate(found)
    return squares[:, squares.any(axis=0)]


def _misfit(robot: Robot, stretches: list[TimedRows], clock: int, period: float) -> Array:
    """Squared residuals (W, n) of a fit of the torques, of joints that have them."""
    width = max(WINDOW, round(SECONDS / period))
    motion, torque = [], []
    for rows in stretches:
        motion.append(_polynomials(rows.times[clock], rows.q, width, width // 2, DEGREE)[0])
        torque.append(_polynomials(rows.times[clock], rows.tau, width, width // 2, TORQUE_DEGREE)[0][0])
    q, v, a = np.concatenate(motion, axis=1)
    y = np.concatenate(torque)
    bodies = body_regressor(robot, configuration(robot, q), v @ robot.drive.T, a @ robot.drive.T)
    left = []
    for j in np.flatnonzero(np.isfinite(y).all(axis=0)):
        friction = np.column_stack([v[:, j], np.sign(v[:, j]), a[:, j], np.ones(len(v))])
        left.append(_residual(np.hstack([bodies[:, j].reshape(len(v), -1), friction]), y[:, j]))
    return np.square(left).T if left else np.empty((len(y), 0))


def _residual(columns: Array, y: Array) -> Array:
    """Residual (W,) of the least-squares fit of y (W,) by columns (W, c)."""
    size = np.linalg.norm(columns, axis=0)
    basis, values, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    basis = basis[:, values > RANK * values[0]]
    return np.asarray(y - basis @ (basis.T @ y))


def _polynomials(t: Array, x: Array, width: int, step: int, degree: int) -> tuple[Array, Array]:
    """Value and two derivatives (3, W, n) of x (N, n) at t (N,) [s] in windows; sums of squared residuals (W, n)."""
    index: NDArray[np.int_] = np.arange(0, len(t) - width + 1, step)[:, None] + np.arange(width)
    times = t[index]
    middle, half = (times[:, [0]] + times[:, [-1]]) / 2, (times[:, [-1]] - times[:, [0]]) / 2
    powers = ((times - middle) / half)[:, :, None] ** np.arange(degree + 1)
    basis, mixed = np.linalg.qr(powers)
    inner = np.swapaxes(basis, 1, 2) @ x[index]
    found = np.linalg.solve(mixed, inner)
    squares = np.square(x[index] - basis @ inner).sum(axis=1)
    return np.stack([found[:, 0], found[:, 1] / half, 2 * found[:, 2] / half**2]), squares
