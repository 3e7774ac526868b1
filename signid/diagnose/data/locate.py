"""Locate a torque: the variable that it depends on most, and the region where it is largest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ...regression.projection import leave
from ...types import Array, Mask
from .hypotheses import VARIABLES, hats
from .periodicity import Wave, find_wave
from .rows import RowTable

EXPLAINED_KNOTS = 9  # knots of the piecewise linear function of a variable. Heuristic
REGION_SHARES = (0.1, 0.2, 0.33, 0.5)  # [1] shares of the rows that regions hold. Heuristic
DIGITS = 2  # significant digits of printed numbers
FREQUENCY_TOLERANCE = 0.05  # [1] relative difference of frequencies that count as one wave. Heuristic
UNITS = {"position": "rad", "velocity": "rad/s", "acceleration": "rad/s2", "torque": "N.m", "time": "s"}


class Location(NamedTuple):
    """Variable and region in which a torque is large."""

    joint: int
    variable: str
    region: str  # "below 0.05 rad/s"
    share: float  # share of the torque's sum of squares in that region [1]
    explained: float  # share of the sum of squares that a function of the variable explains [1]


def locate(
    table: RowTable, joint: int, torque: Array, prismatic: bool = False, variables: Sequence[str] = VARIABLES
) -> Location:
    """Find the variable of a joint that torque (M,) [N.m or N] depends on most, and the region where it is densest."""
    explained = {name: _explained(table.variable(joint, name), torque) for name in variables}
    best = max(explained, key=lambda name: explained[name])
    wave = _wave(table, torque) if "time" in variables else None
    if wave is not None and wave.share > explained[best]:
        return Location(joint, "time", f"at {wave.frequency:.{DIGITS + 1}g} Hz", wave.share, wave.share)
    x = table.variable(joint, best)
    power = torque**2 / max(float(np.sum(torque**2)), 1e-300)
    unit = UNITS[best].replace("N.m", "N").replace("rad", "m") if prismatic else UNITS[best]
    regions = [(float(power[inside].sum()), float(inside.mean()), text) for text, inside in _regions(best, x, unit)]
    share, _, region = max(regions, key=lambda r: r[0] - r[1])
    return Location(joint, best, region, share, explained[best])


def _wave(table: RowTable, torque: Array) -> Wave | None:
    """Sine of the longest piece, with the share of torque in the sines of its frequency of all pieces; None without."""
    edges = [0, *(np.flatnonzero(np.diff(table.piece)) + 1).tolist(), len(table)]
    waves = [find_wave(torque[a:b], 1 / float(table.t[a + 1] - table.t[a])) for a, b in pairwise(edges) if b > a + 1]
    longest = max(waves, key=lambda wave: len(wave.signal))
    if not longest.share:
        return None
    own = sum(
        float(wave.signal @ wave.signal)
        for wave in waves
        if abs(wave.frequency / longest.frequency - 1) < FREQUENCY_TOLERANCE
    )
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
        size, (inside, outside) = np.abs(x), ("within", "beyond")
        if name == "velocity":
            inside, outside = "slower than", "faster than"
        yield f"above 0 {unit}", x > 0
        yield f"below 0 {unit}", x < 0
        for share in REGION_SHARES:
            low, high = np.quantile(size, [share, 1 - share])
            yield f"{inside} {low:.{DIGITS}g} {unit}", size <= low
            yield f"{outside} {high:.{DIGITS}g} {unit}", size >= high
        return
    for share in REGION_SHARES:
        edges = np.quantile(x, np.arange(0, 1 + 1e-9, share))
        for low, high in zip(edges[:-1], edges[1:], strict=True):
            yield f"{low:.{DIGITS + 1}g} to {high:.{DIGITS + 1}g} {unit}", (x >= low) & (x <= high)
