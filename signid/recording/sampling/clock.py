"""What the time stamps of a recording look like, before anything else is read."""

from __future__ import annotations

from math import log
from typing import NamedTuple

import numpy as np

from ...errors import RecordingError
from ...types import Array, Recording

CHUNK = 65_536  # rows
LOOKS = 16  # chunks, evenly spread, that the period is taken from
GAP, GAP_SECONDS = 3.5, 0.01  # in periods and in seconds: longer than both is a gap
CLOSE = 0.02  # of a period: stamps nearer than this are one and the same
SLOWEST, FASTEST = 5.0, 1e-5  # s: sampling periods beyond are no seconds
USUAL = 5e-3  # s
UNITS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9, "hours": 3600.0, "days": 86400.0}
COARSEST = 0.25  # of a period: how coarsely stamps may be rounded for sampling to count as uniform


class Clock(NamedTuple):
    """Times between samples, and how finely they are written [s]."""

    period: float  # median
    mean: float  # gaps left out
    step: float  # of the stamps as they are written: 1e-3 where none has more than three digits

    @property
    def rounding(self) -> float:
        """By how much two stamps may be off because of their digits [s]; 0 where these are too coarse to tell."""
        return self.step if self.step <= COARSEST * self.period else 0.0

    @property
    def gap(self) -> float:
        """Longest time between two samples of one stretch [s]."""
        return max(GAP * self.period, GAP_SECONDS) * (1 + 1e-6) + self.rounding

    @property
    def close(self) -> float:
        """Times nearer than this count as repeated [s]."""
        return CLOSE * self.period


def read_clock(recording: Recording, name: str) -> Clock:
    """The clock of a recording, from at most a million of its samples, evenly spread.

    Raises:
        RecordingError: there is one sample, or time is empty, infinite, constant, goes back all along, or is not in
            seconds.
    """
    column, rows = recording.columns["t"][0], len(recording)
    if rows < 2:
        raise RecordingError(f"{name} is too short: it holds a single sample; record at least some seconds of motion")
    pieces = min(LOOKS, -(-rows // CHUNK))
    starts = [round(i * (rows - min(rows, CHUNK)) / max(1, pieces - 1)) for i in range(pieces)]
    looks = [recording.table.read((column,), start, start + CHUNK)[:, 0] for start in starts]
    stamps = [look[~np.isnan(look)] for look in looks]
    steps = np.concatenate([np.diff(look) for look in stamps])
    last = stamps[-1][-64:]
    if not any(len(look) for look in stamps):
        raise RecordingError(f"{name}: column {column!r} holds no value; expected time in seconds")
    if not all(np.isfinite(look).all() for look in stamps):
        raise RecordingError(f"{name}: column {column!r} holds an infinite time; remove those rows")
    forward = steps[steps > 0]
    if not len(forward):
        fault = "goes back at every row" if (steps < 0).any() else f"does not change from {stamps[0][0]:g}"
        raise RecordingError(f"{name}: time {fault}; expected seconds that increase from row to row")
    period = float(np.median(forward))
    if not FASTEST <= period <= SLOWEST:
        advice = f"it looks like {likely_unit(period)}; convert it to seconds"
        raise RecordingError(f"{name}: column {column!r} steps by {period:g}, which cannot be seconds: {advice}")
    mean = float(forward[(forward <= max(GAP * period, GAP_SECONDS)) & (forward > CLOSE * period)].mean())
    return Clock(period, mean, _step(last) if len(last) else 0.0)


def likely_unit(step: float) -> str:
    """The unit in which a step of time is the most usual sampling period."""
    return min(UNITS, key=lambda unit: abs(log(step * UNITS[unit] / USUAL)))


def _step(stamps: Array) -> float:
    """Smallest step of the stamps (N,) [s]: a power of ten where all are written with so many digits."""
    limit = 4 * float(np.spacing(np.abs(stamps).max()))
    for digits in range(10):
        scaled = stamps * 10.0**digits
        if limit * 10**digits < 0.01 and np.all(np.abs(scaled - np.rint(scaled)) < 1e-6 + limit * 10**digits):
            return max(10.0**-digits, limit)
    if np.array_equal(stamps, stamps.astype(np.float32)):
        return float(np.spacing(np.abs(stamps).max().astype(np.float32)))
    return limit
