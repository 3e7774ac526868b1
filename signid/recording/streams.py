"""Columns with clocks of their own: brought to the times of another stream, and the offset between two clocks.

The offset is the shift at which signals of one file explain those of the other best.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import RecordingError, shorten
from ..types import Array
from .vocabulary import WORDS

Stamps = NDArray[np.int64]  # [ns]
SLOWER = 1.1  # maximum period of interpolated topics [periods of the base topic]
GAP, GAP_NS = 3.5, 0.01e9  # a gap exceeds both [periods], [ns] and is not interpolated
WRAP = 5.0  # [rad] larger jumps of position are wraps of the encoder


class TimedColumns(NamedTuple):
    """Columns with common time stamps.

    columns: (N,) each, by name [any unit].
    """

    topic: str  # or file
    t: Stamps  # (N,) [ns] increasing
    columns: Mapping[str, Array]  # (N,) each, by name: "q_elbow"
    wraps: Mapping[str, float]  # by name of a position: a larger jump is a wrap of the encoder
    row: str = "message"

    @property
    def period(self) -> float:
        """Median period [ns]."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else np.inf

    @property
    def weight(self) -> tuple[bool, int]:
        """Sort key: streams with torque first, then those with most values."""
        return any(name.startswith("tau_") for name in self.columns), len(self.columns) * len(self.t)


def at_times(
    base: TimedColumns, others: Sequence[TimedColumns], notes: list[str], *, slower: bool
) -> tuple[dict[str, Array], slice]:
    """Columns of all streams at the times of one, and the rows of it in which all streams were recorded.

    Columns are interpolated, but not across gaps. Streams that are slower than the base are omitted unless `slower`.

    Raises:
        RecordingError: the streams do not overlap in time.
    """
    columns, used = dict(base.columns), []
    for stream in others:
        fresh = {name: values for name, values in stream.columns.items() if name not in columns}
        if both := [name for name in stream.columns if name in columns]:
            notes.append(f"{stream.topic}: {shorten(both)} omitted, an earlier topic has the same")
        slow = f"{1e9 / stream.period:.3g} Hz is slower than the {1e9 / base.period:.3g} Hz of {base.topic}"
        late = stream.period > SLOWER * base.period
        if fresh and (len(stream.t) < 2 or (late and not slower)):
            notes.append(f"{stream.topic}: {shorten(list(fresh))} omitted: {slow}")
        elif fresh:
            columns |= {name: _onto(base.t, stream, name) for name in fresh}
            used += [] if all(name.startswith(("q_des_", "dq_des_")) for name in fresh) else [stream]
            if stream.topic != base.topic:
                caveat = f"; {slow}" if late else ""
                notes.append(f"{stream.topic}: interpolated at the times of {base.topic}, not across gaps{caveat}")
    first, last = max(x.t[0] for x in (base, *used)), min(x.t[-1] for x in (base, *used))
    inside = slice(*np.searchsorted(base.t, [first, last + 1]))
    if not len(base.t[inside]):
        raise RecordingError(f"topics {base.topic} and {used[0].topic} do not overlap in time; convert them separately")
    if cut := len(base.t) - len(base.t[inside]):
        other = "topic" if base.row == "message" else "file"
        notes.append(f"{base.topic}: {plural(cut, base.row)} at the ends omitted, where another {other} has none")
    return {name: values[inside] for name, values in columns.items()}, inside


def plural(number: int, thing: str) -> str:
    """A number of things: "1 message", "2 messages"."""
    return f"{number} {thing}{'' if number == 1 else 's'}"


def _onto(t: Stamps, stream: TimedColumns, name: str) -> Array:
    """Column (M,) interpolated at other times, NaN in gaps, before and after; t: (M,) [ns]."""
    y, times = stream.columns[name], stream.t
    i = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
    step, after = times[i + 1] - times[i], t - times[i]
    share = after / step
    chord = y[i + 1] - y[i]
    wrapped = np.abs(chord) > stream.wraps.get(name, np.inf)
    value = np.where(wrapped, np.where(share < 0.5, y[i], y[i + 1]), y[i] + share * chord)
    reached = (after >= 0) & (after <= step) & (step <= max(GAP * stream.period, GAP_NS))
    value = np.where(reached, value, np.nan)
    return np.where(after == 0, y[i], np.where(after == step, y[i + 1], value))


SMOOTH, MIN_WINDOW_ROWS = 0.05, 5  # [s] window of the derivative of a position; its least number of rows
FRICTION_SPEED_SHARE = 0.1  # [1] speed over its rms at which friction reverses
BIN = 0.1  # [s]
JOINT_COLUMNS, MAX_COLUMNS = 6, 40  # columns of a joint and of all joints that may explain a torque
BIAS = 0.1  # [s] error of an offset by a share of the torque that the fit of the motion leaves
CELLS = 100_000  # of the grid on which shifts are compared: rows times columns
OVERLAP = 0.5  # share of the shorter file that overlaps at every shift that is tried
FORCES = ("tau", "current")
EXPLAINING = {  # kinds that explain a signal, the sharpest first, and the order of derivative; -1: a fit of the motion
    "measured": {"dq": [("q", 1)], "ddq": [("dq", 1), ("q", 2)], "tau": [("current", 0)], "current": [("tau", 0)]},
    "force": {kind: [("q", -1)] for kind in FORCES},
    "command": {"q_des": [("q", 0)], "dq_des": [("dq", 0), ("q", 1)]},
}
ROWS = 20_000  # most rows of a grid on which shifts are compared
MIN_EXPLAINED = 0.5  # [1] least share of a signal that is explained
AROUND = 0.5  # [s] the best peak at most so much further from no shift than the nearest good one is chosen
RIVAL, RIVAL_SHARE = 3.0, 0.002  # a second peak is one whose residual is below either: [residual of the best], [1]
NARROW = 0.05  # [s] peaks nearer than this are one
MIN_OVERLAP_ROWS = 50  # rows that overlap
QUIET = 1e-3  # [1] variance of a part over that of the whole, below which it says nothing
BLOCKS = 20  # blocks of rows whose scores count as independent
RIDGE = 1e-9


class Readings(NamedTuple):
    """A signal of a joint with finite values, at times of its own clock.

    x: (N,) [any unit].
    """

    t: Array  # (N,) [s]
    x: Array  # (N,)


AllReadings = Mapping[tuple[str, str], Readings]  # by kind and joint


class Offset(NamedTuple):
    """Time that is to be added to that of the second file."""

    shift: ClockShift
    pairs: tuple[str, ...]  # "velocity of elbow with position of elbow"
    command: bool  # whether it includes the time that a servo takes to follow
    force: bool  # whether a torque was explained by the motion


class _Pair(NamedTuple):
    words: str
    motion: Predictors
    answer: TargetSignal
    swapped: bool  # whether the first file has the signal that is explained


def estimate_offset(first: AllReadings, second: AllReadings, overlap: float) -> Offset | str:
    """Offset between the clocks of two files, or why there is none.

    `overlap`: time in which the clocks overlap [s]; 0 if they do not. Velocities and accelerations are compared with
    derivatives, torques and currents with a fit of position, velocity, its sign and acceleration; commands with the
    motion only if there is no other pair.
    """
    reason = "they have no signals of one joint of which one follows from the other"
    for sharp in EXPLAINING:
        pairs = [*_pairs(first, second, sharp, False), *_pairs(second, first, sharp, True)]
        shift = _common(pairs, overlap) if pairs else reason
        if not isinstance(shift, str):
            return Offset(shift, tuple(pair.words for pair in pairs), sharp == "command", sharp == "force")
        reason = shift
    return reason


def _pairs(moving: AllReadings, other: AllReadings, sharp: str, swapped: bool) -> Iterator[_Pair]:
    """Signals of one file that columns of another explain."""
    for (kind, joint), track in other.items():
        for source, order in EXPLAINING[sharp].get(kind, ()):
            if (source, joint) in moving and len(track.t) >= MIN_OVERLAP_ROWS:
                _, place = np.unique(np.floor((track.t - track.t[0]) / BIN), return_index=True)
                mean = np.add.reduceat(track.x, place) / np.diff(np.append(place, len(track.x)))
                crossings = int(
                    np.sum(np.diff(np.sign(mean - mean.mean())) != 0)
                )  # of its mean, with noise averaged out
                made = _motion(moving, (source, joint), order, min(MAX_COLUMNS, crossings))
                if made is not None:
                    with_what = "the motion" if order < 0 else f"its {WORDS[source]}"
                    words = f"{WORDS[kind]} of {joint} with {with_what}"
                    positive = kind not in FORCES
                    yield _Pair(words, made, TargetSignal(track.t, track.x, positive), swapped)
                break


def _motion(moving: AllReadings, key: tuple[str, str], order: int, most: int) -> Predictors | None:
    """Derivative of a signal, or all that may drive a torque, on an even grid; None if it does not move.

    At most `most` columns are made, so that they cannot fit any slow signal.
    """
    from scipy.signal import savgol_filter  # slow import

    track = moving[key]
    steps = np.diff(track.t)
    if len(track.t) < MIN_OVERLAP_ROWS or not np.ptp(track.x) > 0 or most < (JOINT_COLUMNS if order < 0 else 1):
        return None
    period = max(float(np.median(steps)), float(np.ptp(track.t)) / (4 * ROWS))
    t = np.arange(track.t[0], track.t[-1] + 1e-9, period)
    q = np.interp(t, track.t, track.x)
    after = np.clip(np.searchsorted(track.t, t, side="right") - 1, 0, len(steps) - 1)
    known = steps[after] <= max(GAP * period, GAP_NS / 1e9)
    window = max(MIN_WINDOW_ROWS, round(SMOOTH / period) // 2 * 2 + 1)
    if len(q) <= window:
        return None

    def derivative(x: Array, degree: int) -> Array:
        return np.asarray(savgol_filter(x, window, 3, deriv=degree, delta=period))

    if order == 0:
        columns = [q]
    elif order > 0:
        columns = [derivative(q, order)]
    else:
        dq, shape = derivative(q, 1), (q - q.mean()) / q.std()
        slow = FRICTION_SPEED_SHARE * float(np.sqrt(np.mean(dq * dq))) + 1e-300
        columns = [dq, derivative(q, 2), np.tanh(dq / slow), shape, shape**2, shape**3]
        for other, rival in moving.items():
            if other[0] == key[0] and other != key and len(rival.t) >= MIN_OVERLAP_ROWS and np.ptp(rival.x) > 0:
                x = np.interp(t, rival.t, rival.x)
                level = (x - x.mean()) / max(float(x.std()), 1e-300)
                columns += [derivative(x, 2), level, level**2, level * shape]
        columns = columns[:most]
    return Predictors(float(t[0]), period, np.column_stack(columns), known)


def _common(pairs: Sequence[_Pair], overlap: float) -> ClockShift | str:
    """One shift for all pairs, weighted by their precision, or why there is none."""
    spans = [(np.ptp(pair.motion.t), np.ptp(pair.answer.t)) for pair in pairs]
    period = max(max(p.motion.period, float(np.median(np.diff(p.answer.t)))) for p in pairs)
    wide = max(pair.motion.x.shape[1] for pair in pairs)
    period = max(period, max(map(max, spans)) * wide / CELLS)
    profiles = []
    for pair, span in zip(pairs, spans, strict=True):
        shifts, explained = coarse_shifts(pair.motion, pair.answer, period, OVERLAP * float(min(span)))
        profiles.append((-shifts[::-1], explained[::-1]) if pair.swapped else (shifts, explained))
    if not all(len(shifts) for shifts, _ in profiles):
        return "too few rows overlap"
    low, high = max(shifts[0] for shifts, _ in profiles), min(shifts[-1] for shifts, _ in profiles)
    grid = np.arange(low, high + period / 2, period)
    mean = np.mean([np.interp(grid, shifts, explained) for shifts, explained in profiles], axis=0)
    near, rivalled = pick_shift(grid, mean, bool(overlap > OVERLAP * min(map(min, spans))))
    if np.isnan(near):
        return f"no shift explains more than {MIN_EXPLAINED:.0%} of {pairs[0].words.partition(' with ')[0]}"
    if rivalled:
        return "the motion repeats itself, so several shifts explain it as well"
    clear: list[ClockShift] = []
    for pair in pairs:
        sign = -1.0 if pair.swapped else 1.0
        shift = fine_shift(pair.motion, pair.answer, sign * near, 2 * period)
        bias = BIAS * (1 - shift.explained) if pair.motion.x.shape[1] > 1 else 0.0
        if shift.explained >= MIN_EXPLAINED and np.isfinite(shift.std):
            clear.append(shift._replace(seconds=sign * shift.seconds, std=float(np.hypot(shift.std, bias))))
    if not clear:
        return "no shift explains the signals"
    values = np.array([shift.seconds for shift in clear])
    weights = 1 / np.maximum([shift.std for shift in clear], 1e-6) ** 2
    mean_shift = float(np.average(values, weights=weights))
    scatter = float(np.average((values - mean_shift) ** 2, weights=weights)) / max(1, len(clear) - 1)
    explained_share, unshifted = (float(np.mean([shift[k] for shift in clear])) for k in (2, 3))
    std = float(np.sqrt(max(1 / weights.sum(), scatter)))  # not smaller than their scatter
    return ClockShift(mean_shift, std, explained_share, unshifted)


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
    use = count >= max(MIN_OVERLAP_ROWS, min(least / period, len(x), len(y)))
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
    variance = power - level * level
    explained = np.where(variance > QUIET, np.sum(shared * solved, axis=1) / np.maximum(variance, QUIET), 0.0)
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
    tops = tops[explained[tops] >= MIN_EXPLAINED]
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
        if use.sum() < MIN_OVERLAP_ROWS or not np.var(y[use]) > 0:
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
    minimum = minimize_scalar(lambda s: solved(s)[0], bounds=bounds, method="bounded", options={"xatol": 1e-6})
    share, std, _ = solved(float(minimum.x))
    return ClockShift(float(minimum.x), std, 1 - share, 1 - solved(0.0)[0])
