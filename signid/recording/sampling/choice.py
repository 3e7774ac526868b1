"""Choose the clock of a recording whose stamps are not uniform, by the evidence of torques and positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...robot import configuration, hold, resting
from ...robot.dynamics import body_regressor
from ...types import Array, Frozen, Recording, Robot
from .clock import CHUNK, Clock, fit_even

MOST_ROWS, MOST_SECONDS = 20_000, 60.0  # part of a recording that is compared
WINDOW, SECONDS = 11, 0.08  # length of the local polynomials: at least both [rows], [s]
DEGREE, TORQUE_DEGREE = 4, 2
BLOCKS, MIN_BLOCK_WINDOWS = 20, 4  # most blocks that are compared; windows of a block
RANK = 1e-6  # [1] singular values below are zero, relative to the largest
CLEAR_TORQUE, CLEAR_POSITION = (0.02, 4.0), (0.05, 5.0)  # mean log ratio of rms [1] and standard errors that decide
ALONE = 2.0  # factor on both for positions without torques


@dataclass(frozen=True, eq=False)
class Choice(Frozen):
    """Clock of the rows of a recording.

    Kinds: `stamps`, times as recorded (even steps up to rounding, or any others, which are resampled); `even`, an even
    clock without the errors of the stamps; `ticks`, the same where rows are missing, counted by the stamps.
    """

    kind: str
    period: float  # [s] of the uniform grid
    jitter: float = 0.0  # [s] rms error of the stamps that the clock removes
    missing: int = 0  # dropped rows, without gaps
    times: Array | None = field(default=None, repr=False)  # (rows,) [s] of all rows of the file; None: its stamps

    @classmethod
    def stamps(cls, period: float) -> Choice:
        """The stamps as they are, with a period [s]."""
        return cls("stamps", period)


def choose_clock(
    recording: Recording, robot: Robot, clock: Clock, spans: Sequence[tuple[int, int]], dropped: NDArray[np.intp]
) -> Choice:
    """Choose between stamps that are not uniform, and an even clock with dropped rows.

    The even clock is a candidate if the stamps are near it (`fit_even`). Torques and positions of at most 60 s and
    20,000 rows then decide (`second_is_better`); where they do not, the stamps stay. Usable rows are those start..stop
    of the spans without the dropped: (d,) rows, which repeat a time.
    """
    column, rows = recording.columns["t"], len(recording)
    stamps = np.concatenate([recording.table.read(column, k, k + CHUNK)[:, 0] for k in range(0, rows, CHUNK)])
    known = ~np.isnan(stamps)
    known[dropped] = False
    even = fit_even(stamps[known], clock)
    if even is None:
        return Choice.stamps(clock.period)
    times = np.full(rows, np.nan)
    times[known] = even.times
    times[dropped] = times[np.flatnonzero(known)[np.searchsorted(np.flatnonzero(known), dropped) - 1]]
    part = _part(recording, robot, (stamps, times), known, spans)
    same = robot.joints == recording.joints
    moving = robot if same else hold(robot, resting(robot, but=recording.joints))
    if not second_is_better(moving, part, even.period):
        return Choice.stamps(clock.period)
    return Choice("ticks" if even.missing else "even", even.period, even.jitter, even.missing, times)


def _part(
    recording: Recording,
    robot: Robot,
    times: tuple[Array, Array],
    known: NDArray[np.bool_],
    spans: Sequence[tuple[int, int]],
) -> list[TimedRows]:
    """Rows of the longest stretches, in their order."""
    chosen, rows, seconds = [], 0, 0.0
    for start, stop in sorted(spans, key=lambda span: span[0] - span[1]):
        stop = min(stop, start + MOST_ROWS - rows)
        inside = start + np.flatnonzero(known[start:stop])
        late = int(np.searchsorted(times[0][inside], times[0][start] + MOST_SECONDS - seconds, side="right"))
        inside = inside[:late]
        if len(inside) < 2:
            break
        rows, seconds = rows + len(inside), seconds + float(np.ptp(times[0][inside]))
        chosen.append(inside)
    found, prismatic = [], robot.prismatic[[robot.index(joint) for joint in recording.joints]]
    for inside in sorted(chosen, key=lambda rows: int(rows[0])):
        first = int(inside[0])
        samples = recording.read(first, int(inside[-1]) + 1, servo=False)
        at = inside - first
        q = np.where(prismatic, samples.q[at], np.unwrap(samples.q[at], axis=0))
        tau = np.where(recording.signed, samples.tau[at], np.nan)
        found.append(TimedRows((times[0][inside], times[1][inside]), q, tau))
    return found


class TimedRows(NamedTuple):
    """Rows of one stretch of n joints."""

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
    about = ([_polynomials(x.times[k], x.q, WINDOW, WINDOW, DEGREE)[1] for x in stretches] for k in (0, 1))
    squares = (np.concatenate(each) for each in about)  # of the positions about local polynomials
    positions = _compare(*(each[:, each.any(axis=0)] for each in squares))
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
    blocks = min(BLOCKS, len(first) // MIN_BLOCK_WINDOWS)
    if blocks < 5 or not first.shape[1]:
        return None
    pairs = zip(np.array_split(first, blocks), np.array_split(second, blocks), strict=True)
    sums = np.array([(a.sum(axis=0), b.sum(axis=0)) for a, b in pairs])  # (blocks, 2, n)
    least = 1e-12 * sums.mean(axis=(0, 1)) + np.finfo(float).tiny
    ratio = 0.5 * np.log((sums[:, 0] + least) / (sums[:, 1] + least)).mean(axis=1)
    error = ratio.std(ddof=1) / np.sqrt(blocks)
    mean = float(ratio.mean())
    return _Comparison(mean, mean / max(float(error), 1e-12))


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
        columns = np.hstack([bodies[:, j].reshape(len(v), -1), friction])
        size = np.linalg.norm(columns, axis=0)
        basis, values, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
        basis = basis[:, values > RANK * values[0]]
        left.append(y[:, j] - basis @ (basis.T @ y[:, j]))
    return np.square(left).T if left else np.empty((len(y), 0))


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
