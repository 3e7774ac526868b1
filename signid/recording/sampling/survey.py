"""Find the usable rows and the faults of a recording in one pass."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ...errors import RecordingError
from ...types import Array, Recording, Robot, Samples
from .accumulate import Accumulator, register_spans
from .checks import Facts, faults, notes
from .choice import Choice, choose_clock
from .clock import CHUNK, Clock, read_clock, time_origin
from .content import Content, content_notes, find_content, widest
from .grid import Sampling, at_content, row_reader

SIGNALS = ("t", "q", "tau", "dq", "ddq", "q_des")
NEEDED = ("t", "q", "tau")
DERIVATIVES = ("dq", "ddq")
ROUNDED = 0.02  # [1] resolution of stamps over the period, and part of a period, from which rounding matters
ROUND = 6.2  # [rad] joints with a smaller range cannot wrap around


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
        return sampling if _is_rounded(clock, sampling.period) else _limited(recording, sampling)
    spans = [(stretch.start, stretch.stop) for stretch in facts.accumulated.stretches]
    choice = choose_clock(recording, robot, clock, spans, dropped)
    if choice.times is not None:
        clock = Clock(choice.period, choice.period, 0.0)
        facts, dropped = _read(recording, robot, clock, wraps, choice)
    return _limited(recording, _sampling(facts, clock, dropped))


def _is_rounded(clock: Clock, period: float) -> bool:
    """Whether stamps are rounded so coarsely that samples at rounded times look like interpolated ones."""
    count = period / clock.step if clock.step > ROUNDED * period else 0.0
    return abs(count - round(count)) > ROUNDED


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
    dead = [name for name in derivatives if name not in columns.moving]
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
