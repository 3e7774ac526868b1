"""Recordings -> stretches of each joint in which its drive holds, with commands as they were recorded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...errors import RecordingError
from ...recording.sampling.clock import GAP, GAP_SECONDS, read_clock
from ...types import Array, Mask, Recording, Samples, ServoSamples

HUGE = 1e9  # [rad or m] implausible position
MIN_STRETCH_ROWS, BRIEFEST = 12, 0.3  # of a stretch [rows], [s]
EVEN = 0.5  # accepted difference of a time step from the median [1]


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
    found = np.isfinite(samples.q[:, joint]) & np.isfinite(samples.q_des[:, joint])
    if samples.servo is not None and samples.servo.on is not None:
        found &= ~(samples.servo.on[:, joint] < 0.5)  # unknown counts as on
    return np.asarray(found)


def read_stamps(t: Array, rows: Mask) -> RowClock:
    """Clock of the rows; t: (N,) [s], rows: (N,) with a command."""
    both, steps = rows[1:] & rows[:-1], np.diff(t)
    own = steps[both]
    forward = own[own > 0]
    repeated, back, count = int(np.sum(own == 0)), int(np.sum(own < 0)), int(rows.sum())
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
