"""One pass over a recording that finds what can be used of it, and what is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...errors import RecordingError
from ...types import Array, Recording, Robot, Samples
from .accumulate import Open, Tally
from .checks import Facts, notes, refuse
from .clock import CHUNK, Clock, read_clock
from .stretch import Sampling, Stretch

SIGNALS = ("t", "q", "tau", "dq", "ddq", "q_des")
NEEDED = ("t", "q", "tau")
ROUND = 6.2  # rad: a joint with less room than a turn cannot wrap around


@dataclass
class _Columns:
    """What is checked value by value."""

    recording: Recording
    name: str
    missing: dict[str, int] = field(default_factory=dict)  # values, by column
    incomplete: int = 0  # rows
    dropped: list[NDArray[np.intp]] = field(default_factory=list)
    last: float = -np.inf  # [s]

    def missing_rows(self, chunk: Samples, start: int) -> NDArray[np.bool_]:
        """(N,) rows that lack a value that is needed; values that are missing are counted."""
        rows = np.zeros(len(chunk.t), bool)
        for key in SIGNALS:
            values = getattr(chunk, key)
            group = self.recording.columns.get(key, ())
            names = [name for name in group if name]
            if values is None or not names:
                continue
            values = values.reshape(len(rows), -1)[:, [bool(name) for name in group]]
            if np.isfinite(values).all():
                continue
            if np.isinf(values).any():
                row, column = np.argwhere(np.isinf(values))[0]
                fault = f"column {names[column]!r} is infinite in row {start + row + 1}"
                raise RecordingError(f"{self.name}: {fault}; leave the cell empty where a value is missing")
            empty = np.isnan(values)
            for name, count in zip(names, empty.sum(axis=0), strict=True):
                self.missing[name] = self.missing.get(name, 0) + int(count)
            if key in NEEDED:
                rows |= empty.any(axis=1)
        return rows

    def repeated_rows(self, t: Array, start: int, close: float) -> NDArray[np.bool_]:
        """(N,) rows whose time is that of the row before; t: (N,) [s]."""
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
    """How a recording is sampled, which rows can be used, and how far and fast its joints move.

    A row is left out where the time, a position or a torque is missing, or where the time is that of the row before
    (to 2 % of a period). The recording is split there and at gaps longer than 3.5 periods and 10 ms; what is then
    shorter than 8 samples or 0.5 s is left out. Sampling counts as uniform when time is a straight line to 0.1 % of
    a period, over 1, 16 and 256 samples, but for the rounding of the stamps. Encoders that wrap around are unwrapped.
    Memory does not grow with the number of samples.

    Raises:
        RecordingError: the samples cannot be used; the sentence says where and why.
    """
    name = recording.path or "the recording"
    place = [robot.index(joint) for joint in recording.joints]
    clock = read_clock(recording, name)
    room = robot.upper[place] - robot.lower[place]
    wraps = ~robot.prismatic[place] & ((room >= ROUND) | (room <= 0))
    columns, tally = _Columns(recording, name), Tally(clock, wraps)
    for start in range(0, len(recording), CHUNK):
        chunk = recording.read(start, start + CHUNK)
        repeated = columns.repeated_rows(chunk.t, start, clock.close)
        missing = columns.missing_rows(chunk, start) & ~repeated
        columns.incomplete += int(missing.sum())
        tally.take(start, chunk.t, chunk.q, chunk.tau, missing, repeated)
    tally.close()
    dropped = np.concatenate(columns.dropped)
    facts = Facts(name, recording, robot, tally, columns.missing, columns.incomplete, len(dropped))
    refuse(facts)
    return _sampling(facts, clock, dropped)


def _sampling(facts: Facts, clock: Clock, dropped: NDArray[np.intp]) -> Sampling:
    tally, total = facts.tally, facts.tally.total
    kept = sum(stretch.kept for stretch in tally.stretches)
    duration = sum(stretch.t - stretch.stamps[0] for stretch in tally.stretches)
    period = duration / (kept - len(tally.stretches)) if tally.uniform else clock.period
    return Sampling(
        period=period,
        uniform=tally.uniform,
        jitter=(float(total.shortest), float(total.longest)),
        duplicates=len(dropped),
        spans=tuple((stretch.start, stretch.stop) for stretch in tally.stretches),
        lower=total.lower,
        upper=total.upper,
        speed=facts.speed,
        torque_rms=np.sqrt(total.power / total.samples),
        rows=kept,
        duration=duration,
        notes=tuple(notes(facts)),
        stretches=tuple(_stretch(stretch, period, tally.uniform) for stretch in tally.stretches),
        dropped=dropped,
        turn_rows=np.array(tally.turn_rows, np.intp),
        turns=np.array(tally.turns).reshape(-1, len(total.lower)),
        incomplete=frozenset(name for name, count in facts.missing.items() if count),
    )


def _stretch(found: Open, period: float, uniform: bool) -> Stretch:
    size = found.kept if uniform else int((found.t - found.stamps[0]) / period * (1 + 1e-9)) + 1
    return Stretch(found.start, found.stop, np.array(found.stamps), found.kept, size, 0, size)
