"""Find the usable rows and the faults of a recording in one pass; errors and notes are one sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import RecordingError
from ...types import Array, Recording, Robot, Samples
from ..streams import plural
from ..vocabulary import INTEGRAL
from .accumulate import Accumulator, register_spans
from .choice import Choice, choose_clock
from .clock import CHUNK, MAX_REPEATED_SHARE, Clock, likely_unit, read_clock, time_origin
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
                some = (np.nan_to_num(values) != 0).any(axis=0)
                self.moving.update(name for name, moves in zip(names, some, strict=True) if moves)
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
    said = tuple(content_notes(recording.columns, limited.content)) if limited.content else ()
    return replace(limited, notes=(*limited.notes, *said))


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
    yield from _degrees(facts)
    if clock.period >= MILLISECONDS and clock.step >= 1 and facts.speed.max() < CRAWL:
        unit = likely_unit(clock.period)
        yield f"time steps by {clock.period:g}, which is too slow for seconds; it looks like {unit}: convert it"
    yield from _dead_torques(facts)
    total, columns = facts.accumulated.total, facts.recording.columns
    sizes = np.maximum(np.abs(total.lower), np.abs(total.upper)), np.sqrt(total.power / total.samples)
    for key, size in zip(("q", "tau"), sizes, strict=True):
        for column, reached in zip(columns[key], size, strict=True):
            if column and not reached < HUGE:
                yield f"column {column!r} reaches {reached:.3g}, an implausible value; check the column and its unit"


def _degrees(facts: Facts) -> Iterator[str]:
    total, (lower, upper) = facts.accumulated.total, facts.limits
    names, fastest = facts.recording.columns["q"], facts.robot.velocity_limit[facts.place]
    for j in np.flatnonzero(~facts.robot.prismatic[facts.place]):
        low, high = total.lower[j], total.upper[j]
        reach, advice = f"column {names[j]!r} goes from {low:.4g} to {high:.4g}", RADIANS
        if np.isfinite(lower[j]) and np.isfinite(upper[j]):
            fits = low * DEGREE > lower[j] - 0.1 and high * DEGREE < upper[j] + 0.1
            beyond = max(high - upper[j], lower[j] - low)
            if fits and beyond > EXCESS and (facts.speed[j] > fastest[j] or beyond > RANGES * (upper[j] - lower[j])):
                yield f"{reach}, limits are {lower[j]:.4g} to {upper[j]:.4g} rad: it is in degrees; {advice}"
        elif not names[j].startswith(INTEGRAL) and high - low > SPIN and facts.speed[j] > RACE:
            yield f"{reach} at {facts.speed[j]:.4g} each second: it seems to be in degrees; {advice}"


def _dead_torques(facts: Facts) -> Iterator[str]:
    total = facts.accumulated.total
    for j, column in enumerate(facts.recording.columns["tau"]):
        if not column or total.least[j] != total.most[j]:
            continue
        joint = facts.recording.joints[j]
        if total.most[j] == 0:
            yield f"column {column!r} is zero throughout; record the torque of {joint}, or remove the column"
        elif facts.moves[j]:
            yield f"column {column!r} is constant although {joint} moves; record its torque, or remove the column"


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
    yield from _joint_notes(facts)
    for key, word in (("dq", "velocities"), ("ddq", "accelerations")):
        columns = zip(facts.recording.columns.get(key, ()), facts.moves, strict=False)
        if dead := [name for name, moves in columns if moves and name in facts.dead]:
            yield f"{', '.join(dead)}: zero throughout although the joints move; {word} are computed from positions"


def _joint_notes(facts: Facts) -> Iterator[str]:
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
