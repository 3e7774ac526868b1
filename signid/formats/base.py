"""What a file format provides, and the table that holds columns in memory."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..errors import OptionError, RecordingError
from ..types import Array, Table

MOST = 8_000_000_000  # bytes, unpacked, of a file that is read whole


class Format(ABC):
    """One kind of file that holds named columns."""

    name: str
    suffixes: tuple[str, ...]  # lower case, with the dot: (".csv", ".csv.gz")
    description: str

    def recognises(self, path: Path) -> bool:
        """Whether the file is of this kind, by its name."""
        return path.name.lower().endswith(self.suffixes)

    @abstractmethod
    def open(self, path: Path) -> Table:
        """The table in the file.

        Raises:
            RecordingError: when the file cannot be read as a table of this kind.
        """

    def encode(self, columns: Mapping[str, Array], file: str) -> bytes:
        """What a file of this kind holds; the same columns give the same bytes.

        Args:
            columns: (N,) each, by name [s, rad or m, N.m or N].
            file: its name, where the kind has several suffixes.

        Raises:
            OptionError: files of this kind are read only.
        """
        raise OptionError(f"files of the format {self.name} are read, not written; write .csv or .parquet")


class MemoryTable:
    """Columns of one length held in memory; a column that cannot be used says why, but only when it is asked for."""

    def __init__(self, usable: Mapping[str, Array], unusable: Mapping[str, str], source: str) -> None:
        self._usable, self._unusable, self._source = dict(usable), dict(unusable), source
        self.columns = (*self._usable, *self._unusable)
        self.rows = min((len(column) for column in self._usable.values()), default=0)

    def read(self, names: Sequence[str], start: int, stop: int) -> Array:
        """Rows start..stop of the columns named, (stop - start, len(names)), NaN where empty.

        Raises:
            RecordingError: when a column does not exist or does not hold numbers.
        """
        for name in names:
            if name not in self._usable:
                raise RecordingError(refusal(self._source, name, self._unusable.get(name), self.columns))
        result = np.empty((len(names), max(0, min(stop, self.rows) - start)))
        for i, name in enumerate(names):
            result[i] = self._usable[name][start:stop]
        return result.T


def refusal(source: str, column: str, reason: str | None, columns: Sequence[str]) -> str:
    """The sentence about a column that cannot be read; without a reason it does not exist."""
    if reason:
        return f"{source}: column {column!r} {reason}"
    return f"{source} has no column {column!r}; it has {', '.join(columns[:12])}{', ...' if len(columns) > 12 else ''}"


def memory_table(arrays: Mapping[str, ArrayLike], source: str) -> MemoryTable:
    """Arrays by name as a table: one value a sample, or a matrix "q" that becomes q_1 to q_n.

    Args:
        arrays: each (N,) or (N, n), in the units of the columns of these names [s, rad or m, N.m or N, A].
        source: what the sentences of errors call it.

    Raises:
        RecordingError: when a matrix stands the wrong way round.
    """
    given = {name: np.asarray(value) for name, value in arrays.items()}
    columns: dict[str, np.ndarray] = {}
    for name, value in given.items():
        if value.ndim == 2 and 1 < value.shape[1] == np.size(given.get("t", ())) != value.shape[0]:
            fault = f"has shape {value.shape}, expected {value.shape[::-1]}, a row for each sample; transpose it"
            raise RecordingError(f"{source}: {name!r} {fault}")
        if value.ndim == 2 and name != "t":
            columns.update({f"{name}_{k + 1}": value[:, k] for k in range(value.shape[1])})
        else:
            columns[name] = value.ravel() if name == "t" else value
    length = _length(columns)
    faults = {name: fault for name, column in columns.items() if (fault := _fault(column, *length))}
    usable = {name: np.array(column, np.float64) for name, column in columns.items() if name not in faults}
    return MemoryTable(usable, faults, source)


def _length(columns: Mapping[str, np.ndarray]) -> tuple[str, int]:
    """The column that says how many samples there are (t, or else the longest), and their number."""
    sizes = {name: len(column) for name, column in columns.items() if column.ndim == 1}
    name = "t" if "t" in sizes else max(sizes, key=lambda each: sizes[each], default="t")
    return name, sizes.get(name, 0)


def _fault(column: np.ndarray, reference: str, rows: int) -> str:
    """Why an array is not a column of numbers, "" when it is."""
    if column.dtype.kind not in "biuf":
        return "holds no plain numbers; give real numbers, one a sample"
    if column.ndim != 1:
        return f"has shape {column.shape}, expected one value a sample"
    return "" if len(column) == rows else f"has {len(column)} values, expected {rows} as {reference!r} has"
