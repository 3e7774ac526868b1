"""Ask which of two columns of time counts where they disagree."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator

import numpy as np

from ...errors import RecordingError
from ...types import Array, Table
from .clock import CHUNK, SLOWEST, UNITS, likely_unit, resolution

NAME = re.compile(r"(?<![a-z])(?:t|time|times|timestamps?|stamps?|clock|zeit)(?![a-z])", re.IGNORECASE)
CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")
FEWEST = 8  # rows with both times
DIFFERENT = 0.02  # [periods] difference beyond rounding from which two columns disagree
SHARE = 0.99  # quantile of the differences; 1 - SHARE is the other one
RATE = 2.0  # factor between the rates of two columns beyond which the other one counts something else


def ask_for_time(table: Table, chosen: str, used: Collection[str], source: str) -> None:
    """Refuse a table whose column of time was not stated and has a rival that disagrees with it.

    `chosen`: the column `t`, "" if there is none; `used`: columns of signals.

    Raises:
        RecordingError: two columns of time disagree.
    """
    for first, other, apart in rivals(table, chosen, used):
        fact = f"{source} has two columns of time that differ by up to {apart * 1e3:.3g} ms: {first} and {other}"
        choice = f'write t = "{first}" or t = "{other}" into a column map (--columns)'
        raise RecordingError(f"{fact}; {choice}, preferably the time at which the robot took the sample")


def rivals(table: Table, chosen: str, used: Collection[str]) -> Iterator[tuple[str, str, float]]:
    """Column of time, one that disagrees with it, and by how much [s].

    Columns count as time if they are named so and increase. They agree up to a constant, a decimal unit, and rounding.
    """
    names = [name for name in table.columns if name not in used and NAME.search(CAMEL.sub("_", name))]
    names = [chosen, *(name for name in names if name != chosen)] if chosen else names
    times = dict(_increasing(table, names)) if len(names) > 1 else {}
    first = next(iter(times), "")
    if chosen and first != chosen:
        return
    for other in list(times)[1:]:
        if (apart := _apart(times[first], times[other])) is not None:
            yield first, other, apart


def _increasing(table: Table, names: list[str]) -> Iterator[tuple[str, Array]]:
    """Columns (N,) [any unit] of numbers that never decrease, from the first rows."""
    for name in names:
        try:
            values = table.read([name], 0, min(table.rows, CHUNK))[:, 0]
        except RecordingError:  # a column of texts
            continue
        steps = np.diff(values[np.isfinite(values)])
        if len(steps) >= FEWEST and np.all(steps >= 0) and steps.any():
            yield name, values


def _apart(t: Array, other: Array) -> float | None:
    """Range of the differences [s] of two columns (N,) [any unit]; None if they agree or are not alike."""
    both = np.isfinite(t) & np.isfinite(other)
    t, other = t[both], other[both]
    if len(t) < FEWEST or not min(np.ptp(t), np.ptp(other)) > 0:
        return None
    ratio = np.ptp(t) / np.ptp(other)
    unit = 10.0 ** (3 * round(np.log10(ratio) / 3))
    if not 1 / RATE <= ratio / unit <= RATE:
        return None
    steps = np.diff(t)
    period = float(np.median(steps[steps > 0]))
    apart = (t - t[0]) - unit * (other - other[0])
    spread = float(np.diff(np.quantile(apart, [1 - SHARE, SHARE]))[0])
    rounding = max(resolution(t[-64:]), unit * resolution(other[-64:]))  # of the coarser one
    if spread <= (1 + DIFFERENT) * rounding + DIFFERENT * period:
        return None
    return float(np.ptp(apart)) * (1.0 if period <= SLOWEST else UNITS[likely_unit(period)])
