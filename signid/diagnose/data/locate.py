"""Locate a torque: the variable that it depends on most, the region where it is largest, its strongest sine."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ...regression.projection import least_squares, leave
from ...types import Array, Mask
from .hypotheses import VARIABLE_NAMES, hats
from .rows import RowTable

EXPLAINED_KNOTS = 9  # knots of the piecewise linear function of a variable. Heuristic
REGION_SHARES = (0.1, 0.2, 0.33, 0.5)  # [1] shares of the rows that regions hold. Heuristic
REGION_DIGITS = 2  # significant digits of printed numbers
FREQUENCY_TOLERANCE = 0.05  # [1] relative difference of frequencies that count as one wave. Heuristic
VARIABLE_UNITS = {"position": "rad", "velocity": "rad/s", "acceleration": "rad/s2", "torque": "N.m", "time": "s"}


MIN_WAVE_CYCLES = 3.0  # [1] cycles in the signal, at least: a slower sine is drift. Heuristic
OVERSAMPLING = 16  # frequencies of the periodogram for each that the length resolves. Heuristic
MIN_WAVE_SAMPLES = 32  # samples; in a shorter signal no sine is sought. Heuristic


class Wave(NamedTuple):
    """A sine that was fitted to a signal."""

    frequency: float  # [Hz]
    signal: Array  # (N,) [unit of the signal] the sine
    share: float  # share of the signal's sum of squares [1]


def find_wave(x: Array, rate: float) -> Wave:
    """Fit a sine to x (N,) [any unit]: frequency at the peak of an oversampled periodogram, size by least squares.

    Source: Schuster's periodogram, as in Stoica, Moses, Spectral Analysis of Signals, 2005, section 4.3.
    """
    whole = float(x @ x)
    if len(x) < MIN_WAVE_SAMPLES or whole == 0:
        return Wave(0.0, np.zeros_like(x), 0.0)
    lowest = int(MIN_WAVE_CYCLES * OVERSAMPLING)
    power = np.abs(np.fft.rfft(x, OVERSAMPLING * len(x))) ** 2
    k = lowest + int(np.argmax(power[lowest:-1]))
    before, here, after = power[k - 1 : k + 2].tolist()
    bend = before - 2 * here + after
    peak = k + ((before - after) / bend / 2 if bend < 0 else 0.0)  # vertex of the parabola through three points
    frequency = peak * rate / (OVERSAMPLING * len(x))
    angle = 2 * np.pi * frequency / rate * np.arange(len(x))
    columns = np.column_stack([np.cos(angle), np.sin(angle)])
    signal = np.asarray(columns @ least_squares(columns, x))
    return Wave(frequency, signal, float(signal @ signal) / whole)


class Location(NamedTuple):
    """Variable and region in which a torque is large."""

    joint: int
    variable: str
    region: str  # "below 0.05 rad/s"
    share: float  # share of the torque's sum of squares in that region [1]
    explained: float  # share of the sum of squares that a function of the variable explains [1]
    origin: float = 0.0  # [s] time stamp from which reports count times, where the torque is largest


def locate(
    table: RowTable, joint: int, torque: Array, prismatic: bool = False, variables: Sequence[str] = VARIABLE_NAMES
) -> Location:
    """Find the variable of a joint that torque (M,) [N.m or N] depends on most, and the region where it is densest."""
    explained = {name: _explained(table.variable(joint, name), torque) for name in variables}
    best = max(explained, key=lambda name: explained[name])
    wave = _wave(table, torque) if "time" in variables else None
    if wave is not None and wave.share > explained[best]:
        text = f"at {wave.frequency:.{REGION_DIGITS + 1}g} Hz"
        return Location(joint, "time", text, wave.share, wave.share, _origin(table, torque))
    origin = _origin(table, torque)
    x = table.variable(joint, best) - (origin if best == "time" else 0.0)
    power = torque**2 / max(float(np.sum(torque**2)), 1e-300)
    unit = VARIABLE_UNITS[best].replace("N.m", "N").replace("rad", "m") if prismatic else VARIABLE_UNITS[best]
    regions = [(float(power[inside].sum()), float(inside.mean()), text) for text, inside in _regions(best, x, unit)]
    share, _, region = max(regions, key=lambda r: r[0] - r[1])
    region += " since the start" if best == "time" and origin else ""
    return Location(joint, best, region, share, explained[best], origin)


def _origin(table: RowTable, torque: Array) -> float:
    """Time stamp from which reports count in the recording in which torque (M,) [N.m or N] is largest [s]."""
    return table.origins[int(table.piece[np.argmax(np.abs(torque))])] if table.origins else 0.0


def _wave(table: RowTable, torque: Array) -> Wave | None:
    """Sine of the longest piece, with the share of torque in the sines of its frequency of all pieces; None without."""
    edges = [0, *(np.flatnonzero(np.diff(table.piece)) + 1).tolist(), len(table)]
    waves = [find_wave(torque[a:b], 1 / float(table.t[a + 1] - table.t[a])) for a, b in pairwise(edges) if b > a + 1]
    longest = max(waves, key=lambda wave: len(wave.signal))
    if not longest.share:
        return None
    same = [wave for wave in waves if abs(wave.frequency / longest.frequency - 1) < FREQUENCY_TOLERANCE]
    own = sum(float(wave.signal @ wave.signal) for wave in same)
    return longest._replace(share=own / max(float(torque @ torque), 1e-300))


def _explained(x: Array, torque: Array) -> float:
    """Adjusted R2 of a piecewise linear function of x [1]."""
    knots = np.unique(np.quantile(x, np.linspace(0, 1, EXPLAINED_KNOTS)))
    if len(knots) < 3:
        return 0.0
    columns = np.column_stack([np.ones_like(x), hats(x, knots.tolist())])
    left = leave(torque, columns)
    whole = float(torque @ torque)
    free = max(len(x) - columns.shape[1], 1) / len(x)
    return 1 - float(left @ left) / whole / free if whole > 0 else 0.0


def _regions(name: str, x: Array, unit: str) -> Iterator[tuple[str, Mask]]:
    """Regions of the range of a variable: text and mask of the rows."""
    if name in ("velocity", "acceleration", "torque"):
        inside, outside = ("slower than", "faster than") if name == "velocity" else ("within", "beyond")
        size = np.abs(x)
        yield f"above 0 {unit}", x > 0
        yield f"below 0 {unit}", x < 0
        for share in REGION_SHARES:
            low, high = np.quantile(size, [share, 1 - share])
            yield f"{inside} {low:.{REGION_DIGITS}g} {unit}", size <= low
            yield f"{outside} {high:.{REGION_DIGITS}g} {unit}", size >= high
        return
    for share in REGION_SHARES:
        edges = np.quantile(x, np.arange(0, 1 + 1e-9, share))
        for low, high in zip(edges[:-1], edges[1:], strict=True):
            yield f"{low:.{REGION_DIGITS + 1}g} to {high:.{REGION_DIGITS + 1}g} {unit}", (x >= low) & (x <= high)
