"""Parquet files, read in slabs."""

from __future__ import annotations

import io
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import polars as pl

from ...errors import RecordingError
from ...types import Array, Table
from .base import Format, refusal
from .panics import BROKEN, hushed

SLAB = 262_144  # [rows] decoded at once
NUMBERS = (pl.Boolean, pl.Null, pl.Datetime, pl.Duration)  # types that are read as numbers
KEPT = 2  # number of slabs in memory, so that reads across a boundary decode nothing twice


class ParquetTable:
    """Columns of a Parquet file; only the most recent slabs are in memory."""

    def __init__(self, path: Path) -> None:
        self._path, self._scan = path, pl.scan_parquet(path, glob=False)
        self._schema = self._scan.collect_schema()
        self._slabs: OrderedDict[int, dict[str, Array]] = OrderedDict()
        self.since: dict[str, int] = {}  # [ns since 1970] first date of a column of dates that was read
        self.columns = tuple(self._schema.names())
        self.rows = int(self._scan.select(pl.len()).collect().item())

    def read(self, names: Sequence[str], start: int, stop: int) -> Array:
        """Read rows start..stop of the named columns, (stop - start, len(names)), NaN where empty.

        Raises:
            RecordingError: missing or non-numeric column, or damaged file.
        """
        for name in names:
            kind = self._schema.get(name)
            if not (kind and (kind.is_numeric() or kind in NUMBERS)):
                reason = f"holds {kind}, expected numbers" if kind else None
                raise RecordingError(refusal(str(self._path), name, reason, self.columns))
        stop = max(start, min(stop, self.rows))
        result = np.empty((len(names), stop - start))
        for k in range(start // SLAB, -(-stop // SLAB) if stop > start else 0):
            low, high = max(start, k * SLAB), min(stop, (k + 1) * SLAB)
            slab = self._slab(k, names)
            for i, name in enumerate(names):
                result[i, low - start : high - start] = slab[name][low - k * SLAB : high - k * SLAB]
        return result.T

    def _slab(self, k: int, names: Sequence[str]) -> dict[str, Array]:
        slab = self._slabs.setdefault(k, {})
        self._slabs.move_to_end(k)
        while len(self._slabs) > KEPT:
            self._slabs.popitem(last=False)
        for name in names:  # decoding several at once needs much more memory for large row groups
            if name not in slab:
                try:
                    with hushed():
                        frame = self._scan.select(self._number(name)).slice(k * SLAB, SLAB).collect()
                except BROKEN as error:
                    fault = f"is damaged after row {k * SLAB}; copy or write it again"
                    raise RecordingError(f"{self._path} {fault}") from error
                slab[name] = frame[name].to_numpy()
        return slab

    def _number(self, name: str) -> pl.Expr:
        """Column as numbers: dates in seconds since the first row, durations in seconds."""
        kind, column = self._schema[name], pl.col(name)
        if isinstance(kind, pl.Duration):
            column = column.cast(pl.Duration("ns")).to_physical() / 1e9
        if isinstance(kind, pl.Datetime):
            column = column.cast(pl.Datetime("ns", kind.time_zone)).to_physical()
            if name not in self.since:
                self.since[name] = self._scan.select(column.drop_nulls().first()).collect().item() or 0
            column = (column - self.since[name]) / 1e9
        return column.cast(pl.Float64)


class Parquet(Format):
    """Streamed, so memory does not grow with the length of the file."""

    name, suffixes = "parquet", (".parquet", ".pq")
    description = "Apache Parquet, streamed"

    def open(self, path: Path) -> Table:
        try:
            with hushed():
                return ParquetTable(path)
        except BROKEN as error:
            raise RecordingError(f"{path} is not a Parquet file, or is cut short; copy or write it again") from error

    def encode(self, columns: Mapping[str, Array], file: str) -> bytes:
        content = io.BytesIO()
        pl.DataFrame(dict(columns)).write_parquet(content)
        return content.getvalue()


PLUGIN = Parquet()
