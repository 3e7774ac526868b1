"""Time window of a recording."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ...errors import OptionError
from ...types import Array, Recording, Table


@dataclass(frozen=True)
class _Rows:
    """Consecutive rows of a table."""

    table: Table
    first: int
    rows: int

    @property
    def columns(self) -> tuple[str, ...]:
        return self.table.columns

    def read(self, names: Sequence[str], start: int, stop: int) -> Array:
        """Rows start..stop, (stop - start, len(names)) [units of the columns]."""
        return self.table.read(names, self.first + start, min(self.first + stop, self.first + self.rows))


def part(recording: Recording, start: float, duration: float) -> Recording:
    """Select the rows of a time window; only time stamps are read.

    Args:
        recording: recording.
        start: start of the window after the first row [s].
        duration: length of the window [s].

    Raises:
        OptionError: the recording ends before the window, or the duration is invalid.
    """
    name, rows = recording.path or "the recording", len(recording)
    column = recording.columns["t"][0]

    def time(row: int) -> float:
        return float(recording.table.read([column], row, row + 1)[0, 0])

    if not (start >= 0 and duration > 0 and duration < float("inf")):
        raise OptionError(
            f"{duration:g} s from {start:g} s on cannot be shown; give a start from 0 s on and a duration above 0 s"
        )
    first, last = time(0), time(rows - 1)
    if start > 0 and not first + start < last:
        raise OptionError(f"{name} lasts {last - first:.4g} s, and has no rows from {start:g} s on; start earlier")
    low = bisect_left(range(rows), first + start, key=time) if start > 0 else 0
    high = bisect_right(range(rows), first + start + duration, key=time)
    return recording if high - low >= rows else replace(recording, table=_Rows(recording.table, low, high - low))
