"""Period and resolution of the time stamps of a recording."""

from __future__ import annotations

from math import log
from typing import NamedTuple

import numpy as np

from ...errors import RecordingError
from ...types import Array, Recording

CHUNK = 65_536  # rows
PIECES = 16  # number of equally spaced chunks that determine the period
GAP, GAP_SECONDS = 3.5, 0.01  # a gap is longer than both [periods], [s]
CLOSE = 0.02  # distance below which stamps count as repeated [periods]
SLOWEST, FASTEST = 5.0, 1e-5  # [s] plausible range of sampling periods; outside, the unit is not seconds
TYPICAL = 5e-3  # [s] typical sampling period
UNITS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9, "hours": 3600.0, "days": 86400.0}
FAR = 1e4  # [s] stamps that begin this far from 0, such as those since 1970, are shown from the start of a recording
COARSEST = 0.25  # coarsest rounding of stamps in uniform sampling [periods]


class Clock(NamedTuple):
    """Time between samples and resolution of the stamps [s]."""

    period: float  # median
    mean: float  # mean without gaps
    step: float  # resolution of the stamps: 1e-3 if they have at most three decimals

    @property
    def rounding(self) -> float:
        """Rounding error of the difference of two stamps [s]; 0 if the resolution is too coarse."""
        return self.step if self.step <= COARSEST * self.period else 0.0

    @property
    def gap(self) -> float:
        """Longest time step within a stretch [s]."""
        return max(GAP * self.period, GAP_SECONDS) * (1 + 1e-6) + self.rounding

    @property
    def close(self) -> float:
        """Time difference below which stamps count as repeated [s]."""
        return CLOSE * self.period


def read_clock(recording: Recording, name: str) -> Clock:
    """Determine the clock of a recording from at most a million equally spaced samples.

    Raises:
        RecordingError: single sample, or a time that is empty, infinite, constant, decreasing, or not in seconds.
    """
    column, rows = recording.columns["t"][0], len(recording)
    if rows < 2:
        raise RecordingError(f"{name} is too short: it has a single sample; record at least a few seconds of motion")
    pieces = min(PIECES, -(-rows // CHUNK))
    starts = [round(i * (rows - min(rows, CHUNK)) / max(1, pieces - 1)) for i in range(pieces)]
    times = [recording.table.read((column,), start, start + CHUNK)[:, 0] for start in starts]
    stamps = [piece[~np.isnan(piece)] for piece in times]
    steps = np.concatenate([np.diff(piece) for piece in stamps])
    last = stamps[-1][-64:]
    if not any(len(piece) for piece in stamps):
        raise RecordingError(f"{name}: column {column!r} has no values; expected time in seconds")
    if not all(np.isfinite(piece).all() for piece in stamps):
        raise RecordingError(f"{name}: column {column!r} has infinite times; remove those rows")
    forward = steps[steps > 0]
    if not len(forward):
        fault = "goes back at every row" if (steps < 0).any() else f"does not change from {stamps[0][0]:g}"
        raise RecordingError(f"{name}: time {fault}; expected seconds that increase from row to row")
    period = float(np.median(forward))
    if not FASTEST <= period <= SLOWEST:
        unit = likely_unit(period)
        advice = f"it looks like {unit}; convert it to seconds" + _line(unit)
        raise RecordingError(f"{name}: column {column!r} steps by {period:g}, which cannot be seconds: {advice}")
    mean = float(forward[(forward <= max(GAP * period, GAP_SECONDS)) & (forward > CLOSE * period)].mean())
    return Clock(period, mean, resolution(last) if len(last) else 0.0)


def time_origin(recording: Recording) -> float:
    """Time stamp from which reports count [s]: the first one if it is far from 0, as in stamps since 1970, else 0."""
    column = recording.columns["t"][0]
    for start in range(0, len(recording), CHUNK):
        stamps = recording.table.read((column,), start, start + CHUNK)[:, 0]
        if (known := stamps[np.isfinite(stamps)]).size:
            return float(known[0]) if abs(known[0]) >= FAR else 0.0
    return 0.0


def likely_unit(step: float) -> str:
    """Unit in which a time step is closest to a typical sampling period."""
    return min(UNITS, key=lambda unit: abs(log(step) + log(UNITS[unit] / TYPICAL)))  # a product could be 0


def resolution(stamps: Array) -> float:
    """Resolution of the stamps (N,) [s]: a power of ten if they have a fixed number of decimals."""
    limit = 4 * float(np.spacing(np.abs(stamps).max()))
    for digits in range(10):
        scaled = stamps * 10.0**digits
        if limit * 10**digits < 0.01 and np.all(np.abs(scaled - np.rint(scaled)) < 1e-6 + limit * 10**digits):
            return max(10.0**-digits, limit)
    if np.array_equal(stamps, stamps.astype(np.float32)):
        return float(np.spacing(np.abs(stamps).max().astype(np.float32)))
    return limit


def _line(unit: str) -> str:
    """Line of a column map for a unit of time, as the end of a message."""
    short = {"milliseconds": "ms", "microseconds": "us", "nanoseconds": "ns", "hours": "h"}.get(unit)
    return f', or write [units] t = "{short}", on two lines, into a column map (--columns)' if short else ""
