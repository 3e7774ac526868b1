"""A part of a recording in time."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ...errors import OptionError
from ...types import Array, Recording, Table


@dataclass(frozen=True)
class _Rows:
    """Rows of a table, counted from their first."""

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
    """The rows within a duration [s] from `start` [s] after the first row; only time stamps are read.

    Raises:
        OptionError: the recording ends before, or the duration is none.
    """
    name, rows = recording.path or "the recording", len(recording)
    column = recording.columns["t"][0]

    def time(row: int) -> float:
        return float(recording.table.read([column], row, row + 1)[0, 0])

    if not (start >= 0 and duration > 0 and duration < float("inf")):
        raise OptionError(f"{duration:g} s from {start:g} s on cannot be shown; give a start and a duration in s")
    first, last = time(0), time(rows - 1)
    if start > 0 and not first + start < last:
        raise OptionError(f"{name} lasts {last - first:.4g} s, so nothing is left from {start:g} s on; start earlier")
    low = bisect_left(range(rows), first + start, key=time) if start > 0 else 0
    high = bisect_right(range(rows), first + start + duration, key=time)
    return recording if high - low >= rows else replace(recording, table=_Rows(recording.table, low, high - low))
