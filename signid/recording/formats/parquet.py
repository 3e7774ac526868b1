"""Parquet files, read in slabs."""

from __future__ import annotations

import io
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from ...errors import RecordingError
from ...types import Array, Table
from .base import BROKEN, MOST_COLUMNS, MOST_DEPTH, MOST_PARTS, Format, hushed, refusal

SLAB = 131_072  # [rows] decoded at once
NUMBERS = (pl.Boolean, pl.Null, pl.Datetime, pl.Duration)  # types that are read as numbers
SEEN = 1000  # [rows] in which the length of lists is found
CACHED_SLABS = 2  # number of slabs in memory, so that reads across a boundary decode nothing twice


class ColumnPart(NamedTuple):
    """A column, or a part of one."""

    column: pl.Expr
    kind: pl.DataType


class ScannedTable:
    """Columns of a scanned file; only the most recent slabs are in memory.

    Lists of numbers are the columns NAME_1 to NAME_n, structures NAME.FIELD.
    """

    def __init__(self, path: Path, scan: pl.LazyFrame) -> None:
        self._path, self._scan = path, scan
        self._parts = dict(self._split(scan.collect_schema()))
        self._slabs: OrderedDict[int, dict[str, Array]] = OrderedDict()
        self.since: dict[str, int] = {}  # [ns since 1970] first date of a column of dates that was read
        self.columns = tuple(self._parts)
        self.rows = int(self._scan.select(pl.len()).collect().item())

    def read(self, names: Sequence[str], start: int, stop: int) -> Array:
        """Read rows start..stop of the named columns, (stop - start, len(names)), NaN where empty.

        Raises:
            RecordingError: missing or non-numeric column, or damaged file.
        """
        for name in names:
            kind = self._parts[name].kind if name in self._parts else None
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
        while len(self._slabs) > CACHED_SLABS:
            self._slabs.popitem(last=False)
        for name in names:  # decoding several at once needs much more memory for large row groups
            if name not in slab:
                try:
                    with hushed():
                        frame = self._scan.select(self._number(name).alias(name)).slice(k * SLAB, SLAB).collect()
                except BROKEN as error:
                    fault = f"is damaged after row {k * SLAB}; copy or write it again"
                    raise RecordingError(f"{self._path} {fault}") from error
                slab[name] = frame[name].to_numpy()
        return slab

    def _number(self, name: str) -> pl.Expr:
        """Column as numbers: dates in seconds since the first row, durations in seconds."""
        column, kind = self._parts[name]
        if isinstance(kind, pl.Duration):
            column = column.cast(pl.Duration("ns")).to_physical() / 1e9
        if isinstance(kind, pl.Datetime):
            column = column.cast(pl.Datetime("ns", kind.time_zone)).to_physical()
            if name not in self.since:
                self.since[name] = self._scan.select(column.drop_nulls().first()).collect().item() or 0
            column = (column - self.since[name]) / 1e9
        return column.cast(pl.Float64)

    def _split(self, schema: Mapping[str, pl.DataType]) -> Iterator[tuple[str, ColumnPart]]:
        """Columns by name, with those of lists and structures.

        Raises:
            RecordingError: more columns than a table may have.
        """
        names: set[str] = set()
        for column, kind in schema.items():
            parts = list(self._parts_of(column, ColumnPart(pl.col(column), kind), 0))
            if any(name in names or (name != column and name in schema) for name, _ in parts):
                parts = [(column, ColumnPart(pl.col(column), kind))]  # columns of their own come first
            names |= {name for name, _ in parts}
            if len(names) > MOST_COLUMNS:
                fault = f"{self._path} has more than {MOST_COLUMNS} columns"
                raise RecordingError(f"{fault}; write only those of the robot")
            yield from parts

    def _parts_of(self, name: str, part: ColumnPart, depth: int) -> Iterator[tuple[str, ColumnPart]]:
        column, kind = part
        if isinstance(kind, pl.Struct) and kind.fields and depth < MOST_DEPTH:
            for field in kind.fields:
                inner = ColumnPart(column.struct.field(field.name), _instance(field.dtype))
                yield from self._parts_of(f"{name}.{field.name}", inner, depth + 1)
        elif isinstance(kind, pl.List | pl.Array) and (number := _instance(kind.inner)).is_numeric():
            lists = column if isinstance(kind, pl.List) else column.arr.to_list()
            sizes = self._scan.select(lists.list.len().alias(name)).head(SEEN).collect().to_series().drop_nulls()
            size = int(sizes[0]) if len(sizes) else 0
            if not 0 < size <= MOST_PARTS:
                yield name, part
                return
            whole = lists.list.len() == size  # a list of another length is missing
            for k in range(size):
                value = pl.when(whole).then(lists.list.get(k, null_on_oob=True))
                yield f"{name}_{k + 1}", ColumnPart(value, number)
        else:
            yield name, part


def _instance(kind: Any) -> pl.DataType:
    """Data type of a field, which may be given as a class."""
    instance: pl.DataType = kind() if isinstance(kind, type) else kind
    return instance


class Parquet(Format):
    """Streamed, so memory does not grow with the length of the file."""

    name, suffixes = "parquet", (".parquet", ".pq")
    description = "Apache Parquet, streamed"

    def open(self, path: Path) -> Table:
        try:
            with hushed():
                return ScannedTable(path, pl.scan_parquet(path, glob=False))
        except BROKEN as error:
            raise RecordingError(f"{path} is not a Parquet file, or is cut short; copy or write it again") from error

    def encode(self, columns: Mapping[str, Array], file: str) -> bytes:
        content = io.BytesIO()
        pl.DataFrame(dict(columns)).write_parquet(content)
        return content.getvalue()


PLUGIN = Parquet()
