"""How a joint answers its command: the best shift, and a delayed second-order response."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...types import Array
from .shift import LONGEST, best_shift
from .tracks import Grid

ROWS, WINDOW = 8000, 1000  # rows that are fitted, and of one window where there are more
MOST = 30  # windows that are fitted
SHARES = (0.0, 0.3, 0.6, 0.9)  # starts: share of the lag that is delay
DAMPINGS = (0.4, 0.8, 1.5, 3.0)  # starts: damping ratio [1]
LOWER, UPPER = (np.log(1e-4), 0.0, np.log(0.05)), (np.log(1.0), 0.98, np.log(8.0))  # of lag [s], share, damping
FAR = 0.03, 1.3  # [s], [1] largest lag over the shift
TINY = 1e-6  # [s] smaller delays are none
LEAST = 0.05  # [1] lag over the shift from which on its interval is meaningful
WORST = 0.5  # [1] largest residual of a response that is of second order
SLOW = 0.1  # [1] speed over its rms at which friction reverses


class Response(NamedTuple):
    """Second-order response to the delayed command; NaN where another one would be nearer."""

    lag: float  # [s]
    lag_std: float  # [s]
    shift: float  # [s]
    correlation: float  # [1] at the shift, with its sign
    scale: float  # [1] motion per command at the shift
    gain: float  # [1] motion per command of slow motion, from the response
    delay: float  # [s]
    bandwidth: float  # [Hz]
    residual: float  # [1]
    width: float  # [rad or m] half width of the hysteresis: dry friction over stiffness, or a dead band


UNKNOWN = Response(*[np.nan] * len(Response._fields))


def find_response(grids: Sequence[Grid]) -> Response:
    """Fit the response of one joint over all its parts, which have the same period."""
    shift, correlation, scale = best_shift(grids)
    windows = _windows(grids)
    spread = float(np.sqrt(np.mean(np.concatenate([(w.q - w.q.mean()) ** 2 for w in windows]))))
    unknown = UNKNOWN._replace(shift=shift, correlation=correlation, scale=scale)
    if spread <= 0 or not abs(shift) <= LONGEST:
        return unknown
    x, log_std = _fitted(windows, max(shift, grids[0].period))
    w, z, delay = _numbers(x)
    lag, flat = delay + 2 * z / w, 1 - 2 * z * z
    residual, (gain, _, width) = _residual(x, windows)
    rest = float(np.sqrt(np.mean(residual**2))) / spread
    if gain <= 0 or rest > WORST or lag > FAR[1] * shift + max(FAR[0], 2 * grids[0].period):
        return unknown
    bandwidth = w / (2 * np.pi) * np.sqrt(flat + np.sqrt(flat * flat + 1))
    sure = delay if delay > TINY else 0.0
    std = lag * log_std if lag > LEAST * shift else shift  # friction alone explains the lag
    return Response(lag, std, shift, correlation, scale, float(gain), sure, float(bandwidth), rest, float(width))


class _Window(NamedTuple):
    q: Array  # (L,)
    command: Array  # (H + L,) with H rows of history
    period: float


def _windows(grids: Sequence[Grid]) -> list[_Window]:
    """At most ROWS rows, those in which the command moves most where there are more; each with its history."""
    history = round(2 * LONGEST / grids[0].period)
    total = sum(len(grid.q) for grid in grids)
    cuts = []
    for grid in grids:
        padded = np.concatenate([np.full(history, grid.command[0]), grid.command])
        size = len(grid.q) if total <= ROWS else min(WINDOW, len(grid.q))
        for start in range(0, len(grid.q) - size + 1, size):
            own = _Window(grid.q[start : start + size], padded[start : start + size + history], grid.period)
            cuts.append((float(np.std(own.command[history:])), own))
    chosen: list[int] = []
    room = ROWS
    for k in sorted(range(len(cuts)), key=lambda k: -cuts[k][0])[:MOST]:
        room -= len(cuts[k][1].q)
        chosen += [k] if room >= 0 or not chosen else []
    return [cuts[k][1] for k in sorted(chosen)]


def _numbers(x: Array) -> tuple[float, float, float]:
    """Natural frequency [rad/s], damping ratio [1] and delay [s] of the logarithm of the lag, the share, and so on."""
    lag, share, damping = float(np.exp(x[0])), float(x[1]), float(np.exp(x[2]))
    return 2 * damping / ((1 - share) * lag), damping, share * lag


def _fitted(windows: Sequence[_Window], lag: float) -> tuple[Array, float]:
    """Numbers (3,) as in `_numbers`, and the standard deviation of the first."""
    from scipy.optimize import least_squares  # slow import

    inside = [np.array(LOWER) + 1e-6, np.array(UPPER) - 1e-6]
    starts = [np.clip([np.log(lag), share, np.log(damping)], *inside) for share in SHARES for damping in DAMPINGS]
    costs = [float(np.mean(_residual(x, windows)[0] ** 2)) for x in starts]
    found = least_squares(
        lambda x: _residual(x, windows)[0],
        starts[int(np.argmin(costs))],
        bounds=(LOWER, UPPER),
        diff_step=1e-4,
        max_nfev=15,
        ftol=1e-5,
    )
    covariance = np.linalg.pinv(found.jac.T @ found.jac, rcond=1e-10)[0, 0] * float(np.mean(found.fun**2))
    return np.asarray(found.x), float(np.sqrt(covariance * _correlated(found.fun)))


def _correlated(residual: Array) -> float:
    """Rows of a residual (N,) for one that is independent: 1 for white noise."""
    power = float(residual @ residual)
    if power <= 0:
        return 1.0
    total = 1.0
    for lag in range(1, len(residual) // 2):
        r = float(residual[lag:] @ residual[:-lag]) / power
        if r < 0:
            break
        total += 2 * r
    return total


def _residual(x: Array, windows: Sequence[_Window]) -> tuple[Array, Array]:
    """Residual (N,) [rad or m] of all windows, and scale, constant and half width of the friction (3,).

    Initial states are eliminated.

    x: (3,) logarithm of the lag [s], share of it that is delay [1], logarithm of the damping ratio.
    """
    from scipy.signal import lfilter  # slow import

    period, (w, z, delay) = windows[0].period, _numbers(x)
    b, a = _discrete(w, z, period)
    answers = [_answer(window, b, a, delay / period) for window in windows]
    rates = [np.gradient(answer) for answer in answers]
    slow = SLOW * float(np.sqrt(np.mean(np.concatenate(rates) ** 2))) + 1e-12
    columns, pulse = [], np.zeros(max(len(window.q) for window in windows) + 1)
    pulse[1] = 1.0
    impulse = lfilter([1.0], a, pulse)
    for window, answer, rate in zip(windows, answers, rates, strict=True):
        size = len(window.q)
        own = np.column_stack([answer, np.ones(size), -lfilter(b, a, np.tanh(rate / slow)), window.q])
        free = np.column_stack([impulse[1 : size + 1], impulse[:size]])
        basis, _ = np.linalg.qr(free)
        columns.append(own - basis @ (basis.T @ own))
    return _solved(np.concatenate(columns))


def _answer(window: _Window, b: Array, a: Array, delay: float) -> Array:
    """Response (L,) to the command of a window that is late by a delay [rows]."""
    from scipy.signal import lfilter

    size, history = len(window.q), len(window.command) - len(window.q)
    whole, share = divmod(delay, 1.0)
    start = history - int(whole)
    late = (1 - share) * window.command[start : start + size] + share * window.command[start - 1 : start - 1 + size]
    return np.asarray(lfilter(b, a, late - late[0]) + late[0])


def _solved(table: Array) -> tuple[Array, Array]:
    """Residual (N,) and coefficients (3,) of scale, constant and friction, which is not negative.

    table: (N, 4) columns of the three, and positions.
    """
    for use in ((0, 1, 2), (0, 1)):
        x = table[:, use]
        value = np.zeros(3)
        value[list(use)] = np.linalg.lstsq(x.T @ x, x.T @ table[:, 3], rcond=1e-12)[0]
        if value[2] >= 0:
            break
    return table[:, 3] - table[:, :3] @ value, value


def _discrete(w: float, z: float, period: float) -> tuple[Array, Array]:
    """Numerator and denominator of the second-order response to a held command, with a gain of one at rest."""
    root = np.sqrt(complex(z * z - 1))
    p, r = np.exp((-z + root) * w * period), np.exp((-z - root) * w * period)
    a = np.real(np.array([1.0, -(p + r), p * r]))
    first = _step_response(w, z, period)
    return np.array([0.0, first, float(a.sum()) - first]), a


def _step_response(w: float, z: float, t: float) -> float:
    """Response to a unit step after a time t [s]."""
    if abs(z - 1) < 1e-6:
        z = 1 + 1e-6
    root = np.sqrt(complex(z * z - 1))
    p, r = (-z + root) * w, (-z - root) * w
    return float(np.real(1 + (r * np.exp(p * t) - p * np.exp(r * t)) / (p - r)))
