"""Shift of one signal in time at which columns of another clock explain it best."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...types import Array

ROWS = 20_000  # most rows of a grid on which shifts are compared
LEAST = 0.5  # [1] least share of a signal that is explained
AROUND = 0.5  # [s] the best peak at most so much further from no shift than the nearest good one is chosen
RIVAL, RIVAL_SHARE = 3.0, 0.002  # a second peak is one whose residual is below either: [residual of the best], [1]
NARROW = 0.05  # [s] peaks nearer than this are one
FEWEST = 50  # rows that overlap
QUIET = 1e-3  # [1] variance of a part over that of the whole, below which it says nothing
BLOCKS = 20  # blocks of rows whose scores count as independent
RIDGE = 1e-9


class Predictors(NamedTuple):
    """Columns on an even grid that may explain a signal.

    x: (N, K) [any unit].
    """

    start: float  # [s]
    period: float  # [s]
    x: Array  # (N, K)
    known: np.ndarray  # (N,) whether the row is no gap

    @property
    def t(self) -> Array:
        """Times (N,) [s]."""
        return np.asarray(self.start + self.period * np.arange(len(self.x)))


class TargetSignal(NamedTuple):
    """A signal that is to be explained.

    y: (M,) [any unit].
    """

    t: Array  # (M,) [s]
    y: Array  # (M,)
    positive: bool  # whether it has the sign of the column that explains it


class ClockShift(NamedTuple):
    """Time that is added to that of a signal."""

    seconds: float
    std: float  # [s]
    explained: float  # [1] share of the signal
    unshifted: float  # [1] the same without the shift; 0 where the clocks do not overlap


def coarse_shifts(motion: Predictors, answer: TargetSignal, period: float, least: float) -> tuple[Array, Array]:
    """Shifts [s] on a grid of a period [s], and the share of the signal that is explained at each.

    At a shift, at least `least` [s] of both overlap.
    """
    from scipy.signal import correlate  # slow import

    size = max(2, int(np.ptp(motion.t) / period) + 1)
    a = motion.start + period * np.arange(size)
    x = np.column_stack([np.interp(a, motion.t, column) for column in motion.x.T])
    b = np.arange(answer.t[0], answer.t[-1] + 1e-9, period)
    y = np.interp(b, answer.t, answer.y)
    x = (x - x.mean(axis=0)) / np.maximum(x.std(axis=0), 1e-300)
    y = (y - y.mean()) / max(float(y.std()), 1e-300)
    shift = np.arange(-(len(y) - 1), len(x))
    low, high = np.maximum(0, shift), np.minimum(len(x), len(y) + shift)
    count = high - low
    use = count >= max(FEWEST, min(least / period, len(x), len(y)))
    shift, low, high, count = shift[use], low[use], high[use], count[use]
    if not len(shift):
        return np.zeros(0), np.zeros(0)

    def windowed(values: Array, first: np.ndarray, last: np.ndarray) -> Array:
        sums = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
        return np.asarray((sums[last] - sums[first]) / count.reshape(-1, *[1] * (values.ndim - 1)))

    mean, square = windowed(x, low, high), windowed(x[:, :, None] * x[:, None, :], low, high)
    level, power = windowed(y, low - shift, high - shift), windowed(y * y, low - shift, high - shift)
    crossed = np.column_stack([correlate(column, y, "full", method="fft")[use] for column in x.T]) / count[:, None]
    covariance = square - mean[:, :, None] * mean[:, None, :] + RIDGE * np.eye(x.shape[1])
    shared = crossed - mean * level[:, None]
    solved = np.linalg.solve(covariance, shared[:, :, None])[:, :, 0]
    own = power - level * level
    explained = np.where(own > QUIET, np.sum(shared * solved, axis=1) / np.maximum(own, QUIET), 0.0)
    moving = np.trace(covariance, axis1=1, axis2=2) > QUIET * x.shape[1]
    explained = np.where(moving & ((shared[:, 0] > 0) | (not answer.positive)), explained, 0.0)
    return a[0] + shift * period - b[0], np.clip(explained, 0.0, 1.0)


def pick_shift(shifts: Array, explained: Array, near_zero: bool) -> tuple[float, bool]:
    """Shift [s] at the peak, NaN if there is none, and whether another one rivals it.

    `near_zero`: where several peaks explain about as much, that near no shift is chosen.

    shifts: (S,) [s].
    explained: (S,) share of the signal [1].
    """
    inner = (explained[1:-1] >= explained[:-2]) & (explained[1:-1] > explained[2:])
    tops = np.flatnonzero(inner) + 1
    tops = tops[explained[tops] >= LEAST]
    if not len(tops):
        return np.nan, False
    best = int(tops[np.argmax(explained[tops])])
    remains = 1 - explained[best]
    rival = 1 - explained[tops] < max(RIVAL * remains, RIVAL_SHARE)
    if near_zero:
        smallest = float(np.min(np.abs(shifts[tops[rival]])))
        near = tops[np.abs(shifts[tops]) <= smallest + AROUND]
        return float(shifts[near[np.argmax(explained[near])]]), False
    return float(shifts[best]), bool((rival & (np.abs(shifts[tops] - shifts[best]) > NARROW)).any())


def fine_shift(motion: Predictors, answer: TargetSignal, near: float, width: float) -> ClockShift:
    """Shift of a signal by least squares within a width [s] of a coarse one, with its standard deviation."""
    from scipy.interpolate import make_interp_spline  # slow import
    from scipy.optimize import minimize_scalar

    spline = make_interp_spline(motion.t, motion.x, k=3)
    rate = spline.derivative()
    step = max(1, len(answer.t) // ROWS)
    t, y = answer.t[::step], answer.y[::step]
    scale = np.maximum(motion.x.std(axis=0), 1e-300)

    def solved(shift: float) -> tuple[float, float, float]:
        """Residual share [1], standard deviation [s], and rows."""
        at = t + shift
        place = np.clip(np.rint((at - motion.start) / motion.period).astype(int), 0, len(motion.x) - 1)
        use = (at >= motion.t[0]) & (at <= motion.t[-1]) & motion.known[place]
        if use.sum() < FEWEST or not np.var(y[use]) > 0:
            return 1.0, np.inf, float(use.sum())
        a = np.column_stack([spline(at[use]) / scale, np.ones(int(use.sum()))])
        slope, *_ = np.linalg.lstsq(a, y[use], rcond=1e-10)
        residual = y[use] - a @ slope
        speed = (rate(at[use]) / scale) @ slope[:-1]
        speed = speed - a @ np.linalg.lstsq(a, speed, rcond=1e-10)[0]
        scores = np.array([part.sum() for part in np.array_split(residual * speed, BLOCKS)])
        power = float(speed @ speed)
        std = float(np.sqrt(scores @ scores)) / power if power > 0 else np.inf
        return float(residual @ residual / np.sum((y[use] - y[use].mean()) ** 2)), std, float(use.sum())

    bounds = near - width, near + width
    found = minimize_scalar(lambda s: solved(s)[0], bounds=bounds, method="bounded", options={"xatol": 1e-6})
    share, std, _ = solved(float(found.x))
    return ClockShift(float(found.x), std, 1 - share, 1 - solved(0.0)[0])
