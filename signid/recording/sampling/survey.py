"""Usable rows, clock and faults of a recording in one pass; errors and notes are one sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import RecordingError
from ...robot import configuration, hold, resting
from ...robot.dynamics import body_regressor
from ...types import Array, Recording, Robot, Samples
from ..streams import plural
from ..vocabulary import INTEGRAL
from .accumulate import Accumulator, register_spans
from .clock import CHUNK, MAX_REPEATED_SHARE, Choice, Clock, fit_even, likely_unit, read_clock, time_origin
from .grid import Content, Sampling, at_content, content_notes, find_content, row_reader, widest

SIGNALS = ("t", "q", "tau", "dq", "ddq", "q_des")
NEEDED = ("t", "q", "tau")
DERIVATIVES = ("dq", "ddq")
ROUNDED = 0.02  # [1] resolution of stamps over the period, and part of a period, from which rounding matters
ROUND = 6.2  # [rad] joints with a smaller range cannot wrap around
MIN_USED_SAMPLES = 20  # minimum number of usable samples
EXCESS, RANGES = 6.5, 2.0  # [rad], [ranges of motion] beyond the limits from which positions may be degrees
SPIN, RACE = 60.0, 50.0  # [rad], [rad/s] beyond both, a joint without limits may be in degrees
DEGREE = np.pi / 180
MILLISECONDS, CRAWL = 0.5, 0.05  # [s], [rad/s] integer time steps this long with slower motion are milliseconds
HUGE = 1e9  # [rad, m, N.m or N] implausible magnitude for any robot
MIN_MOTION_RANGE = 1e-9  # [rad or m] smaller ranges count as no motion
RADIANS = 'convert it to radians, or write [units] q = "deg", on two lines, into a column map (--columns)'
MOST_ROWS, MOST_SECONDS = 20_000, 60.0  # part of a recording that is compared
WINDOW, SECONDS = 11, 0.08  # length of the local polynomials: at least both [rows], [s]
POSITION_DEGREE, TORQUE_DEGREE = 4, 2
BLOCKS, MIN_BLOCK_WINDOWS = 20, 4  # most blocks that are compared; windows of a block
RANK = 1e-6  # [1] singular values below are zero, relative to the largest
CLEAR_TORQUE, CLEAR_POSITION = (0.02, 4.0), (0.05, 5.0)  # mean log ratio of rms [1] and standard errors that decide
ALONE = 2.0  # factor on both for positions without torques


@dataclass
class _Columns:
    """Checks of individual values."""

    recording: Recording
    name: str
    missing: dict[str, int] = field(default_factory=dict)  # number of missing values by column
    moving: set[str] = field(default_factory=set)  # recorded velocities and accelerations that are not zero throughout
    incomplete: int = 0  # number of rows with missing values
    dropped: list[NDArray[np.intp]] = field(default_factory=list)
    last: float = -np.inf  # time of the last row [s]

    def missing_rows(self, chunk: Samples, start: int) -> NDArray[np.bool_]:
        """Rows (N,) that lack a required value; missing values are counted."""
        rows = np.zeros(len(chunk.t), bool)
        for key in SIGNALS:
            values = getattr(chunk, key)
            group = self.recording.columns.get(key, ())
            names = [name for name in group if name]
            if values is None or not names:
                continue
            values = values.reshape(len(rows), -1)[:, [bool(name) for name in group]]
            if key in DERIVATIVES:
                not_zero = (np.nan_to_num(values) != 0).any(axis=0)
                self.moving.update(name for name, moves in zip(names, not_zero, strict=True) if moves)
            if np.isfinite(values).all():
                continue
            if np.isinf(values).any():
                row, column = np.argwhere(np.isinf(values))[0]
                fault = f"column {names[column]!r} is infinite in row {start + row + 1}"
                raise RecordingError(f"{self.name}: {fault}; leave cells of missing values empty")
            empty = np.isnan(values)
            for name, count in zip(names, empty.sum(axis=0), strict=True):
                self.missing[name] = self.missing.get(name, 0) + int(count)
            if key in NEEDED:
                rows |= empty.any(axis=1)
        return rows

    def repeated_rows(self, t: Array, start: int, close: float) -> NDArray[np.bool_]:
        """Rows (N,) with the time of the previous row; t: (N,) [s]."""
        known = np.flatnonzero(~np.isnan(t))
        step = np.diff(t[known], prepend=self.last)
        if (step < 0).any():
            k = int(np.argmax(step < 0))
            row, now = start + known[k] + 1, t[known[k]]
            fault = f"row {row}: time goes back from {now - step[k]:.10g} to {now:.10g}"
            raise RecordingError(f"{self.name}, {fault}; sort the rows, or record again with one clock")
        repeated = np.zeros(len(t), bool)
        repeated[known] = step < close
        self.last = float(t[known[-1]]) if len(known) else self.last
        self.dropped.append(start + np.flatnonzero(repeated))
        return repeated


def survey(recording: Recording, robot: Robot) -> Sampling:
    """Determine the sampling, the usable rows and the range of motion of a recording.

    Rows without time, position or torque split the recording, as do gaps longer than 3.5 periods and 10 ms. Rows with
    the time of the previous row (to 2 % of a period) are dropped, and stretches shorter than 8 samples or 0.5 s are
    omitted. Sampling is uniform if time is linear to 0.1 % of a period over 1, 16 and 256 samples, up to the rounding
    of the stamps. Encoder wraps are removed. Memory does not grow with the number of samples of uniform recordings.

    If the stamps are not uniform, an even clock takes their place where torques or positions fit it (`choose_clock`).

    Raises:
        RecordingError: unusable samples.
    """
    name = recording.path or "the recording"
    place = [robot.index(joint) for joint in recording.joints]
    clock = read_clock(recording, name)
    room = robot.upper[place] - robot.lower[place]
    turning, register = ~robot.prismatic[place] & ((room >= ROUND) | (room <= 0)), register_spans(recording)
    wraps = np.where(register > 0, register, 2 * np.pi * turning)
    facts, dropped = _read(recording, robot, clock, wraps, Choice.stamps(clock.period))
    if facts.accumulated.uniform or not facts.accumulated.stretches:
        sampling = _sampling(facts, clock, dropped)
        count = sampling.period / clock.step if clock.step > ROUNDED * sampling.period else 0.0
        rounded = abs(count - round(count)) > ROUNDED  # so coarsely that samples look like interpolated ones
        return sampling if rounded else _limited(recording, sampling)
    spans = [(stretch.start, stretch.stop) for stretch in facts.accumulated.stretches]
    choice = choose_clock(recording, robot, clock, spans, dropped)
    if choice.times is not None:
        clock = Clock(choice.period, choice.period, 0.0)
        facts, dropped = _read(recording, robot, clock, wraps, choice)
    return _limited(recording, _sampling(facts, clock, dropped))


def _limited(recording: Recording, sampling: Sampling) -> Sampling:
    """The sampling at the rate at which the file has content of its own."""
    if not sampling.uniform:
        return sampling
    longest = max(sampling.stretches, key=lambda stretch: stretch.kept)
    knots = find_content(row_reader(recording, sampling, longest), longest.kept)
    if knots is None:
        return sampling
    row = (float(longest.stamps[0]) - float(sampling.stretches[0].stamps[0])) / sampling.period
    moved = {name: tuple(each and each.moved(row) for each in columns) for name, columns in knots.items()}
    limited = at_content(sampling, Content(moved, sampling.period, widest(moved)))
    rate_notes = tuple(content_notes(recording.columns, limited.content)) if limited.content else ()
    return replace(limited, notes=(*limited.notes, *rate_notes))


def _read(
    recording: Recording, robot: Robot, clock: Clock, wraps: Array, choice: Choice
) -> tuple[Facts, NDArray[np.intp]]:
    """One pass over a recording on the times of a clock; what was found, and the rows that repeat a time."""
    name = recording.path or "the recording"
    columns, accumulated = _Columns(recording, name), Accumulator(clock, wraps)
    for start in range(0, len(recording), CHUNK):
        chunk = recording.read(start, start + CHUNK, servo=False)
        if choice.times is not None:
            chunk = chunk._replace(t=choice.times[start : start + CHUNK])
        repeated = columns.repeated_rows(chunk.t, start, clock.close)
        missing = columns.missing_rows(chunk, start) & ~repeated
        columns.incomplete += int(missing.sum())
        accumulated.take(start, chunk.t, chunk.q, chunk.tau, missing, repeated)
    accumulated.close()
    dropped = np.concatenate(columns.dropped)
    derivatives = [name for key in DERIVATIVES for name in recording.columns.get(key, ()) if name]
    dead = [name for name in derivatives if name not in columns.moving and not recording.static]
    facts = Facts(recording, robot, accumulated, columns.missing, columns.incomplete, len(dropped), choice, dead)
    for fault in faults(facts):
        raise RecordingError(f"{name}: {fault}")
    return facts, dropped


def _sampling(facts: Facts, clock: Clock, dropped: NDArray[np.intp]) -> Sampling:
    accumulated, total = facts.accumulated, facts.accumulated.total
    kept = sum(stretch.kept for stretch in accumulated.stretches)
    duration = sum(stretch.t - stretch.stamps[0] for stretch in accumulated.stretches)
    period = duration / (kept - len(accumulated.stretches)) if accumulated.uniform else clock.period
    return Sampling(
        period=period,
        uniform=accumulated.uniform,
        jitter=(float(total.shortest), float(total.longest)),
        duplicates=len(dropped),
        spans=tuple((stretch.start, stretch.stop) for stretch in accumulated.stretches),
        lower=total.lower,
        upper=total.upper,
        speed=facts.speed,
        torque_rms=np.sqrt(total.power / total.samples),
        rows=kept,
        duration=duration,
        notes=tuple(notes(facts)),
        stretches=tuple(stretch.closed(period, accumulated.uniform) for stretch in accumulated.stretches),
        dropped=dropped,
        turn_rows=np.array(accumulated.turn_rows, np.intp),
        turns=np.array(accumulated.turns).reshape(-1, len(total.lower)),
        incomplete=frozenset(name for name, count in facts.missing.items() if count),
        origin=time_origin(facts.recording),
        clock=facts.choice,
    )


class Facts(NamedTuple):
    """Results of the pass over a recording."""

    recording: Recording
    robot: Robot
    accumulated: Accumulator
    missing: Mapping[str, int]  # values, by column
    incomplete: int  # rows
    repeated: int  # rows
    choice: Choice  # clock of the rows
    dead: Sequence[str]  # columns of velocities and accelerations that are zero throughout

    @property
    def speed(self) -> Array:
        """Rms velocity (n,) [rad/s or m/s]."""
        return np.asarray(np.sqrt(self.accumulated.total.motion / max(1, self.accumulated.total.velocities)))

    @property
    def moves(self) -> Array:
        """Whether each joint moved, (n,)."""
        return np.asarray(self.accumulated.total.upper - self.accumulated.total.lower > MIN_MOTION_RANGE)

    @property
    def place(self) -> list[int]:
        """Index of each joint in the robot."""
        return [self.robot.index(joint) for joint in self.recording.joints]

    @property
    def limits(self) -> tuple[Array, Array]:
        """Lower and upper limits, (n,) each [rad or m]; infinite where the description has no valid limits."""
        lower, upper = self.robot.lower[self.place], self.robot.upper[self.place]
        return np.where(lower < upper, lower, -np.inf), np.where(lower < upper, upper, np.inf)


def faults(facts: Facts) -> Iterator[str]:
    """Reasons why a recording is unusable."""
    rows, clock = len(facts.recording), facts.accumulated.clock
    for column, count in facts.missing.items():
        if count == rows:
            yield f"column {column!r} has no values; fill it or remove it"
    if facts.repeated > MAX_REPEATED_SHARE * rows:
        share = f"{facts.repeated} of {rows} samples repeat the time of the sample before"
        yield f"{share}; write the time with more digits, or once for each sample"
    used = facts.accumulated.total.samples
    if used < MIN_USED_SAMPLES:
        least = f"{MIN_USED_SAMPLES} are needed, in stretches of half a second or more without a gap or a missing value"
        worst = max(facts.missing, key=lambda column: facts.missing[column], default="")
        lack = f", {facts.missing[worst]} lack {worst}" if facts.missing.get(worst) else ""
        yield f"too short: only {used} of {rows} samples can be used{lack}; at least {least}"
    if not facts.moves.any():
        constant = ", ".join(facts.recording.columns["q"])
        yield f"no joint moves: position is constant in {constant}; record the robot in motion"
    extremes, (lower, upper) = facts.accumulated.total, facts.limits
    names, fastest = facts.recording.columns["q"], facts.robot.velocity_limit[facts.place]
    for j in np.flatnonzero(~facts.robot.prismatic[facts.place]).tolist():
        low, high = extremes.lower[j], extremes.upper[j]
        reach, advice = f"column {names[j]!r} goes from {low:.4g} to {high:.4g}", RADIANS
        if np.isfinite(lower[j]) and np.isfinite(upper[j]):
            fits = low * DEGREE > lower[j] - 0.1 and high * DEGREE < upper[j] + 0.1
            beyond = max(high - upper[j], lower[j] - low)
            if fits and beyond > EXCESS and (facts.speed[j] > fastest[j] or beyond > RANGES * (upper[j] - lower[j])):
                yield f"{reach}, limits are {lower[j]:.4g} to {upper[j]:.4g} rad: it is in degrees; {advice}"
        elif not names[j].startswith(INTEGRAL) and high - low > SPIN and facts.speed[j] > RACE:
            yield f"{reach} at {facts.speed[j]:.4g} each second: it seems to be in degrees; {advice}"
    if clock.period >= MILLISECONDS and clock.step >= 1 and facts.speed.max() < CRAWL:
        unit = likely_unit(clock.period)
        yield f"time steps by {clock.period:g}, which is too slow for seconds; it looks like {unit}: convert it"
    total, columns = facts.accumulated.total, facts.recording.columns
    for j, (joint, column) in enumerate(zip(facts.recording.joints, columns["tau"], strict=True)):
        if column and total.least[j] == total.most[j] == 0:
            yield f"column {column!r} is zero throughout; record the torque of {joint}, or remove the column"
        elif column and total.least[j] == total.most[j] and facts.moves[j]:
            yield f"column {column!r} is constant although {joint} moves; record its torque, or remove the column"
    sizes = np.maximum(np.abs(total.lower), np.abs(total.upper)), np.sqrt(total.power / total.samples)
    for key, size in zip(("q", "tau"), sizes, strict=True):
        for column, reached in zip(columns[key], size, strict=True):
            if column and not reached < HUGE:
                yield f"column {column!r} reaches {reached:.3g}, an implausible value; check the column and its unit"


def notes(facts: Facts) -> Iterator[str]:
    """Notes on a usable recording, one sentence each."""
    accumulated, rows = facts.accumulated, len(facts.recording)
    if accumulated.gaps:
        length, at = accumulated.longest_gap
        origin = time_origin(facts.recording)
        longest = f"the longest {length:.3g} s at t = {at - origin:.6g} s"
        since = " since the start" if origin else ""
        yield f"{plural(accumulated.gaps, 'gap')} in time split the recording, {longest}{since}"
    if any(facts.missing.values()):
        where = ", ".join(f"{count} in {name}" for name, count in facts.missing.items() if count)
        yield f"values are missing ({where}); {plural(facts.incomplete, 'sample')} of {rows} omitted"
    if facts.repeated:
        yield f"{plural(facts.repeated, 'sample')} dropped: same time as the previous sample"
    if facts.choice.times is not None:
        choice, lost = facts.choice, plural(facts.choice.missing, "row")
        fact = f"stamps of time jitter by {choice.jitter * 1e3:.2g} ms rms around an even clock of"
        lost = f", {lost} {'is' if choice.missing == 1 else 'are'} missing" if choice.missing else ""
        yield f"{fact} {choice.period * 1e3:.5g} ms; the even clock is used{lost}"
    elif not accumulated.uniform:
        least, most = accumulated.total.shortest * 1e3, accumulated.total.longest * 1e3
        fact = f"time steps vary from {least:.4g} to {most:.4g} ms"
        yield f"{fact}: resampled every {accumulated.clock.period * 1e3:.6g} ms by cubic interpolation"
    if accumulated.short:
        stretches = "1 stretch" if accumulated.short == 1 else f"{accumulated.short} stretches"
        yield f"{stretches} shorter than 8 samples or 0.5 s omitted"
    recording, (lower, upper) = facts.recording, facts.limits
    total = facts.accumulated.total
    wraps = {int(j) for turns in facts.accumulated.turns for j in np.flatnonzero(turns)}
    spans = facts.accumulated.spans
    for j, joint in enumerate(recording.joints):
        column, unit = recording.columns["q"][j], "m" if facts.robot.prismatic[facts.place[j]] else "rad"
        beyond = max(total.upper[j] - upper[j], lower[j] - total.lower[j])
        if not facts.moves[j]:
            yield f"column {column} is constant: {joint} did not move"
        elif not recording.columns["tau"][j]:
            yield f"{joint} moves but has no torque column: only the torques of other joints depend on its parameters"
        if beyond > 0:
            yield f"{joint} goes {beyond:.3g} {unit} beyond the limits of its description"
        if j in wraps:
            by = "full turns" if abs(spans[j] - 2 * np.pi) < 1e-9 else f"{spans[j]:.5g} {unit}"
            yield f"column {column} wraps around by {by}: unwrapped"
    for key, word in (("dq", "velocities"), ("ddq", "accelerations")):
        columns = zip(facts.recording.columns.get(key, ()), facts.moves, strict=False)
        if dead := [name for name, moves in columns if moves and name in facts.dead]:
            yield f"{', '.join(dead)}: zero throughout although the joints move; {word} are computed from positions"


def choose_clock(
    recording: Recording, robot: Robot, clock: Clock, spans: Sequence[tuple[int, int]], dropped: NDArray[np.intp]
) -> Choice:
    """Choose between stamps that are not uniform, and an even clock with dropped rows.

    The even clock is a candidate if the stamps are near it (`fit_even`). Torques and positions of at most 60 s and
    20,000 rows then decide (`second_is_better`); where they do not, the stamps stay. Usable rows are those start..stop
    of the spans without the dropped: (d,) rows, which repeat a time.
    """
    rows = len(recording)
    chunks = (recording.table.read(recording.columns["t"], k, k + CHUNK)[:, 0] for k in range(0, rows, CHUNK))
    stamps = np.concatenate(list(chunks))
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
    timed, prismatic = [], robot.prismatic[[robot.index(joint) for joint in recording.joints]]
    for inside in sorted(chosen, key=lambda rows: int(rows[0])):
        first = int(inside[0])
        samples = recording.read(first, int(inside[-1]) + 1, servo=False)
        at = inside - first
        q = np.where(prismatic, samples.q[at], np.unwrap(samples.q[at], axis=0))
        tau = np.where(recording.signed, samples.tau[at], np.nan)
        timed.append(TimedRows((times[0][inside], times[1][inside]), q, tau))
    return timed


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
    about = ([_polynomials(x.times[k], x.q, WINDOW, WINDOW, POSITION_DEGREE)[1] for x in stretches] for k in (0, 1))
    squares = (np.concatenate(residuals) for residuals in about)  # of the positions about local polynomials
    positions = _compare(*(residuals[:, residuals.any(axis=0)] for residuals in squares))
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
        motion.append(_polynomials(rows.times[clock], rows.q, width, width // 2, POSITION_DEGREE)[0])
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
    coefficients = np.linalg.solve(mixed, inner)
    squares = np.square(x[index] - basis @ inner).sum(axis=1)
    return np.stack([coefficients[:, 0], coefficients[:, 1] / half, 2 * coefficients[:, 2] / half**2]), squares
