"""Rows in which a drive holds, and how its joint answers the command: shift, second-order response, errors at rest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...errors import RecordingError
from ...recording.sampling.clock import GAP, GAP_SECONDS, read_clock
from ...types import Array, Mask, Recording, Samples, ServoSamples

MAX_SHIFT, MAX_ROW_SHIFT = 0.6, 2.5  # [s] largest shift of a drive, and of columns that are from different rows
SHARE = 0.2  # [1] largest shift over the duration of the longest part
CERTAIN = 0.95  # correlation beyond MAX_SHIFT; healthy logs with dry friction have it as well
MISFIT_REDUCTION = 0.5  # 1 - |correlation| beyond MAX_SHIFT over that within
FRICTION = 0.3  # variance left beyond MAX_SHIFT over that of a drive with dry friction; healthy logs: above .42
DELAYS = np.linspace(0, 0.3, 4)  # [s] of such a drive
AGAINST = 0.9  # weight of correlations of motion against the command: periodic motion has both signs
NEAREST = 0.98  # correlation of a peak over the largest, from which on the smallest shift is chosen
HUGE = 1e9  # [rad or m] implausible position
MIN_STRETCH_ROWS, BRIEFEST = 12, 0.3  # of a stretch [rows], [s]
EVEN = 0.5  # accepted difference of a time step from the median [1]


class Shift(NamedTuple):
    """Best shift of a command; NaN where none was found."""

    seconds: float  # [s] positive: the position is later
    correlation: float  # [1] with its sign
    scale: float  # [1] motion per command


def best_shift(grids: Sequence[Grid]) -> Shift:
    """Shift of the largest correlation; beyond MAX_SHIFT only if neither one within it nor dry friction is near."""
    near = _best(grids, MAX_SHIFT)
    most = min(MAX_ROW_SHIFT, SHARE * max(len(grid.q) * grid.period for grid in grids))
    if most <= MAX_SHIFT or (near.correlation > CERTAIN and np.isfinite(near.seconds)):
        return near
    rows = round(most / grids[0].period)
    inner = [grid for grid in grids if len(grid.q) > 2 * rows + 2]
    far = _best(inner, most, against=0.0, known=True)
    if not abs(far.seconds) > MAX_SHIFT - 2 * grids[0].period or not far.correlation > CERTAIN:  # NaN: none was found
        return near
    if 1 - far.correlation > MISFIT_REDUCTION * (1 - abs(near.correlation)):
        return near
    rest = 1 - far.correlation**2
    return near if far.seconds > 0 and rest > FRICTION * _rest_of_friction(inner, rows) else far


def _best(grids: Sequence[Grid], longest: float, against: float = AGAINST, known: bool = False) -> Shift:
    """Best shift up to `longest` [s].

    against: weight of motion against the command; known: leave out rows whose shifted command is not recorded.
    """
    from scipy.signal import correlate  # slow import

    period = grids[0].period
    most = max(1, round(longest / period))
    covariance, command_power, power = (np.zeros(2 * most + 1) for _ in range(3))
    for grid in grids:
        inner = grid.q[most : len(grid.q) - most] if known else grid.q
        inner = inner - inner.mean()
        level = grid.command.mean()
        padded = grid.command - level if known else np.pad(grid.command - level, most, mode="edge")
        covariance += correlate(padded, inner, mode="valid")[::-1]  # the largest lead first
        sums = np.cumsum(np.concatenate([[[0.0, 0.0]], np.column_stack([padded, padded**2])]), axis=0)
        total, squares = (sums[len(inner) :] - sums[: -len(inner)])[::-1].T
        command_power += squares - total**2 / len(inner)
        power += inner @ inner
    size = np.sqrt(np.maximum(command_power, 0.0) * power)
    if not (size > 0).any():
        return Shift(np.nan, np.nan, np.nan)
    r = np.where(size > 1e-12 * size.max(), covariance / np.where(size > 0, size, 1.0), 0.0)
    likely = np.where(r > 0, r, -against * r)
    best = int(np.argmax(likely))
    if best in (0, 2 * most):  # beyond the shifts that were tried
        return Shift(np.nan, float(r[best]), float(covariance[best] / command_power[best]))
    k, part = _peak(likely, most)
    return Shift(float((k + part - most) * period), float(r[k]), float(covariance[k] / command_power[k]))


def _rest_of_friction(grids: Sequence[Grid], edge: int) -> float:
    """Share of the variance [1] that a usual delay leaves with dry friction, which looks late in slow motion.

    edge: rows at both ends of each grid that are left out.
    """
    rest = 1.0
    for delay in DELAYS:
        tables = []  # (N, 3) the late command, its last direction, and the position; means removed
        for grid in grids:
            late, stop = round(float(delay) / grid.period), len(grid.q) - edge
            way = np.sign(np.diff(grid.command, prepend=grid.command[0]))
            side = way[np.maximum.accumulate(np.where(way != 0, np.arange(len(way)), 0))]
            rows = slice(edge - late, stop - late)
            table = np.column_stack([grid.command[rows], side[rows], grid.q[edge:stop]])
            tables.append(table - table.mean(axis=0))
        x, y = np.split(np.concatenate(tables), [2], axis=1)
        y = y[:, 0]
        value = np.linalg.lstsq(x.T @ x, x.T @ y, rcond=1e-12)[0]
        if value[1] <= 0:  # friction holds back
            rest = min(rest, float(np.mean((y - x @ value) ** 2) / np.mean(y**2)))
    return rest


def _peak(size: Array, middle: int) -> tuple[int, float]:
    """Index of the peak that is chosen, and how far its top is from there."""
    tops = np.flatnonzero((size[1:-1] >= size[:-2]) & (size[1:-1] >= size[2:])) + 1
    if not len(tops):
        return int(np.argmax(size)), 0.0
    good = tops[size[tops] >= NEAREST * size[tops].max()]
    k = int(good[np.argmin(np.abs(good - middle))])
    curve = size[k - 1] - 2 * size[k] + size[k + 1]
    return k, float(0.5 * (size[k - 1] - size[k + 1]) / curve) if curve < 0 else 0.0


ROWS, WINDOW = 8000, 1000  # rows that are fitted, and of one window where there are more
MAX_FITTED_WINDOWS = 30  # windows that are fitted
SHARES = (0.0, 0.3, 0.6, 0.9)  # starts: share of the lag that is delay
DAMPINGS = (0.4, 0.8, 1.5, 3.0)  # starts: damping ratio [1]
LOWER, UPPER = (np.log(1e-4), 0.0, np.log(0.05)), (np.log(1.0), 0.98, np.log(8.0))  # of lag [s], share, damping
MAX_LAG_EXCESS = 0.03, 1.3  # [s], [1] largest lag over the shift
TINY = 1e-6  # [s] smaller delays are none
MIN_LAG_SHARE = 0.05  # [1] lag over the shift from which on its interval is meaningful
WORST = 0.5  # [1] largest residual of a response that is of second order
REVERSAL_SPEED_SHARE = 0.1  # [1] speed over its rms at which friction reverses


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
    if spread <= 0 or not abs(shift) <= MAX_SHIFT:
        return unknown
    x, log_std = _fitted(windows, max(shift, grids[0].period))
    w, z, delay = _numbers(x)
    lag, flat = delay + 2 * z / w, 1 - 2 * z * z
    residual, (gain, _, width) = _residual(x, windows)
    rest = float(np.sqrt(np.mean(residual**2))) / spread
    if gain <= 0 or rest > WORST or lag > MAX_LAG_EXCESS[1] * shift + max(MAX_LAG_EXCESS[0], 2 * grids[0].period):
        return unknown
    bandwidth = w / (2 * np.pi) * np.sqrt(flat + np.sqrt(flat * flat + 1))
    sure = delay if delay > TINY else 0.0
    std = lag * log_std if lag > MIN_LAG_SHARE * shift else shift  # friction alone explains the lag
    return Response(lag, std, shift, correlation, scale, float(gain), sure, float(bandwidth), rest, float(width))


class _Window(NamedTuple):
    q: Array  # (L,)
    command: Array  # (H + L,) with H rows of history
    period: float


def _windows(grids: Sequence[Grid]) -> list[_Window]:
    """At most ROWS rows, those in which the command moves most where there are more; each with its history."""
    history = round(2 * MAX_SHIFT / grids[0].period)
    total = sum(len(grid.q) for grid in grids)
    cuts = []
    for grid in grids:
        padded = np.concatenate([np.full(history, grid.command[0]), grid.command])
        size = len(grid.q) if total <= ROWS else min(WINDOW, len(grid.q))
        for start in range(0, len(grid.q) - size + 1, size):
            window = _Window(grid.q[start : start + size], padded[start : start + size + history], grid.period)
            cuts.append((float(np.std(window.command[history:])), window))
    chosen: list[int] = []
    room = ROWS
    for k in sorted(range(len(cuts)), key=lambda k: -cuts[k][0])[:MAX_FITTED_WINDOWS]:
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
    fit = least_squares(
        lambda x: _residual(x, windows)[0],
        starts[int(np.argmin(costs))],
        bounds=(LOWER, UPPER),
        diff_step=1e-4,
        max_nfev=15,
        ftol=1e-5,
    )
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac, rcond=1e-10)[0, 0] * float(np.mean(fit.fun**2))
    return np.asarray(fit.x), float(np.sqrt(covariance * _correlated(fit.fun)))


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
    z = z if abs(z - 1) >= 1e-6 else 1 + 1e-6  # two poles
    root = np.sqrt(complex(z * z - 1))
    slow, fast = (-z + root) * w, (-z - root) * w
    p, r = np.exp(slow * period), np.exp(fast * period)
    a = np.real(np.array([1.0, -(p + r), p * r]))
    first = float(np.real(1 + (fast * p - slow * r) / (slow - fast)))
    b = np.array([0.0, first, float(a.sum()) - first])  # of the response to a held command, with a gain of one at rest
    whole, share = divmod(delay / period, 1.0)
    answers = []
    for window in windows:
        size, start = len(window.q), len(window.command) - len(window.q) - int(whole)
        late = (1 - share) * window.command[start : start + size] + share * window.command[start - 1 : start - 1 + size]
        answers.append(lfilter(b, a, late - late[0]) + late[0])
    rates = [np.gradient(answer) for answer in answers]
    slow = REVERSAL_SPEED_SHARE * float(np.sqrt(np.mean(np.concatenate(rates) ** 2))) + 1e-12
    columns, pulse = [], np.zeros(max(len(window.q) for window in windows) + 1)
    pulse[1] = 1.0
    impulse = lfilter([1.0], a, pulse)
    for window, answer, rate in zip(windows, answers, rates, strict=True):
        size = len(window.q)
        model = np.column_stack([answer, np.ones(size), -lfilter(b, a, np.tanh(rate / slow)), window.q])
        free = np.column_stack([impulse[1 : size + 1], impulse[:size]])
        basis, _ = np.linalg.qr(free)
        columns.append(model - basis @ (basis.T @ model))
    table, value = np.concatenate(columns), np.zeros(3)
    for use in ((0, 1, 2), (0, 1)):  # friction is not negative
        x = table[:, use]
        value = np.zeros(3)
        value[list(use)] = np.linalg.lstsq(x.T @ x, x.T @ table[:, 3], rcond=1e-12)[0]
        if value[2] >= 0:
            break
    return table[:, 3] - table[:, :3] @ value, value


SETTLE, LAGS = 0.4, 5.0  # [s], [lags] after the last change of the command
REST_SECONDS = 0.2  # [s] over which a joint at rest stays within two steps of its encoder
MIN_APPROACHES = 2  # approaches of each direction for a dead band
CHANGE = 1e-4  # [1] share of the range of the command below which it does not change


class Rest(NamedTuple):
    """Errors q_des - q at rest."""

    droop: float  # [rad or m] median size
    droop_most: float  # [rad or m]
    holds: int
    dead_band: float  # [rad or m]


def at_rest(parts: Sequence[Part], lag: float, quantum: float, span: float) -> Rest:
    """Errors of one joint at rest; lag [s], quantum of q and range of the command `span` [rad or m]."""
    holds = [hold for part in parts for hold in _holds(part, lag, quantum, span)]
    if not holds:
        return Rest(np.nan, np.nan, 0, np.nan)
    error, way = np.array(holds).T
    up, down = error[way > 0], error[way < 0]
    both = min(len(up), len(down)) >= MIN_APPROACHES
    dead = abs(float(np.median(up) - np.median(down))) / 2 if both else np.nan
    return Rest(float(np.median(np.abs(error))), float(np.abs(error).max()), len(error), dead)


def _holds(part: Part, lag: float, quantum: float, span: float) -> list[tuple[float, float]]:
    """Mean error [rad or m] and direction of approach (1, -1; 0 unknown) of each time at rest."""
    settle = max(SETTLE, LAGS * lag if np.isfinite(lag) else 0.0)
    changed = np.flatnonzero(np.abs(np.diff(part.command)) > CHANGE * span) + 1
    edges = np.concatenate([[0], changed, [len(part.t)]])
    starts = np.searchsorted(part.t, part.t[edges[:-1]] + settle)
    last = part.t[edges[1:] - 1]
    long = (edges[1:] - starts >= 3) & (last - part.t[np.minimum(starts, len(part.t) - 1)] >= REST_SECONDS)
    holds = []
    for k in np.flatnonzero(long).tolist():
        low, first, high = int(edges[k]), int(starts[k]), int(edges[k + 1])
        t, q = part.t[first:high], part.q[first:high]
        away = np.flatnonzero(np.abs(q - q[-1]) > 2.5 * quantum)
        since = int(away[-1]) + 1 if len(away) else 0  # the row from which on the joint does not move any more
        if t[-1] - t[since] >= REST_SECONDS:
            step = float(part.command[low] - part.command[low - 1]) if low else 0.0
            holds.append((float(part.command[low] - np.median(q[since:])), float(np.sign(step))))
    return holds


class Part(NamedTuple):
    """Consecutive rows of one joint with a command."""

    t: Array  # (N,) [s]
    q: Array  # (N,) [rad or m]
    command: Array  # (N,) [rad or m]
    pwm: Array | None  # (N,) [1]
    recording: int = 0  # index


class Grid(NamedTuple):
    """A part on a uniform grid; the command is held from row to row."""

    period: float  # [s]
    q: Array  # (N,) [rad or m]
    command: Array  # (N,) [rad or m]


class RowClock(NamedTuple):
    """Time stamps of the rows with a command."""

    period: float  # [s] median
    duration: float  # [s] without gaps
    uneven: float  # [1] share of steps that differ from the median
    repeated: int  # rows with the time of the row before
    back: int  # rows before the row before
    stretches: tuple[tuple[float, float], ...]  # [s] start and end of rows with a command and without a gap
    rows: int  # with a command


def read_samples(recording: Recording) -> Samples:
    """Read a recording; rows without time are left out.

    Raises:
        RecordingError: too few rows, time that is not in seconds, or implausible positions.
    """
    name = recording.path or "the recording"
    if len(recording) < MIN_STRETCH_ROWS:
        raise RecordingError(f"{name} has {len(recording)} rows; record for longer")
    read_clock(recording, name)
    samples = recording.read()
    for values in (samples.q, samples.q_des):
        if values is not None and np.any(np.abs(values[np.isfinite(values)]) > HUGE):
            raise RecordingError(f"{name} has positions beyond {HUGE:.0e}; check the columns and their units")
    known = np.isfinite(samples.t)
    if known.all():
        return samples
    servo = samples.servo and ServoSamples(*(None if x is None else x[known] for x in samples.servo))
    q_des = None if samples.q_des is None else samples.q_des[known]
    return samples._replace(t=samples.t[known], q=samples.q[known], q_des=q_des, servo=servo)


def driven(samples: Samples, joint: int) -> Mask:
    """Rows (N,) in which a joint has a command and its drive is not off."""
    if samples.q_des is None:
        return np.zeros(len(samples.t), bool)
    known = np.isfinite(samples.q[:, joint]) & np.isfinite(samples.q_des[:, joint])
    if samples.servo is not None and samples.servo.on is not None:
        known &= ~(samples.servo.on[:, joint] < 0.5)  # unknown counts as on
    return np.asarray(known)


def read_stamps(t: Array, rows: Mask) -> RowClock:
    """Clock of the rows; t: (N,) [s], rows: (N,) with a command."""
    both, steps = rows[1:] & rows[:-1], np.diff(t)
    commanded_steps = steps[both]
    forward = commanded_steps[commanded_steps > 0]
    repeated, back, count = int(np.sum(commanded_steps == 0)), int(np.sum(commanded_steps < 0)), int(rows.sum())
    if not len(forward):
        return RowClock(np.nan, 0.0, 0.0, repeated, back, (), count)
    period = float(np.median(forward))
    longest = max(GAP * period, GAP_SECONDS)
    near = forward[forward <= longest]
    uneven = float(np.mean(np.abs(near / period - 1) > EVEN)) if len(near) else 0.0
    edges = np.flatnonzero(np.concatenate([[True], ~both | (steps > longest), [True]]))
    stretches = [(float(t[a]), float(t[b - 1])) for a, b in zip(edges[:-1], edges[1:], strict=True) if rows[a]]
    return RowClock(period, float(near.sum()), uneven, repeated, back, tuple(stretches), count)


def cut(samples: Samples, joint: int, rows: Mask, period: float, recording: int) -> list[Part]:
    """Parts of one joint; rows: (N,) with a command, period [s] of the stamps, index of the recording."""
    assert samples.q_des is not None, "a joint with a command has the column"
    steps = np.diff(samples.t)
    broken = ~(rows[1:] & rows[:-1]) | (steps > max(GAP * period, GAP_SECONDS)) | (steps <= 0)
    edges = np.concatenate([[0], np.flatnonzero(broken) + 1, [len(rows)]])
    pwm = samples.servo.pwm if samples.servo is not None else None
    has_pwm = pwm is not None and bool(np.isfinite(pwm[:, joint]).any())
    parts = []
    for low, high in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        if high - low < MIN_STRETCH_ROWS or not rows[low] or samples.t[high - 1] - samples.t[low] < BRIEFEST:
            continue
        at = slice(low, high)
        duty = pwm[at, joint] if has_pwm and pwm is not None else None
        parts.append(Part(samples.t[at], samples.q[at, joint], samples.q_des[at, joint], duty, recording))
    return parts


def on_grid(part: Part, period: float) -> Grid:
    """A part on a grid of a period [s], from its first row."""
    t = part.t[0] + period * np.arange(int((part.t[-1] - part.t[0]) / period * (1 + 1e-9)) + 1)
    held = np.searchsorted(part.t, t + 0.01 * period, side="right") - 1
    return Grid(period, np.interp(t, part.t, part.q), part.command[held])


def joined(parts: Sequence[Part | Grid], key: str) -> Array:
    """Values of all parts one after another, (N,) [unit of the column]."""
    return np.concatenate([getattr(part, key) for part in parts])


SPARSEST = 20  # rows from one with content to the next
REGULAR = 0.02  # [1] accepted difference of steps of time from their median
MIN_CONTENT_ROWS = 8  # rows with content, below which nothing is concluded
REST = 1e-4  # share of the power of differences in all other rows, below which they have no content (rounding)


def content_rows(t: Array, q: Array) -> slice:
    """Rows with content of their own, of N rows of positions.

    t: (N,) [s]; q: (N, n) [rad or m]. Where positions repeat, their first differences are zero in all rows but every
    k-th; where they are interpolated linearly, their second differences. All rows if neither holds.
    """
    if len(t) < 3 or not np.isfinite(q).all():
        return slice(None)
    steps, moving = np.diff(t), np.ptp(q, axis=0) > 0
    if not moving.any() or np.abs(steps - np.median(steps)).max() > REGULAR * np.median(steps):
        return slice(None)
    for order in (1, 2):
        power = np.sum((np.diff(q[:, moving], order, axis=0) / np.ptp(q[:, moving], axis=0)) ** 2, axis=1)
        for k in range(min(SPARSEST, len(power) // MIN_CONTENT_ROWS), 1, -1):
            share = np.array([power[first::k].sum() for first in range(k)]) / max(power.sum(), 1e-300)
            first = int(np.argmax(share))
            if 1 - share[first] < REST and np.count_nonzero(power[first::k] > REST * power.mean()) >= MIN_CONTENT_ROWS:
                return slice((first + 1) % k, None, k)
    return slice(None)


def content_rate(t: Array, q: Array) -> float:
    """Rate [Hz] of the rows with content of their own; t: (N,) [s]; q: (N, n) [rad or m]."""
    return float(1 / np.median(np.diff(t[content_rows(t, q)])))
