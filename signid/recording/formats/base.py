"""What a file format provides, and the table that holds columns in memory."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...errors import OptionError, RecordingError
from ...types import Array, Table

MOST = 8_000_000_000  # bytes, unpacked, of a file that is read whole


class Topic(NamedTuple):
    """What a log holds under one name."""

    name: str
    kind: str  # "sensor_msgs/msg/JointState"
    messages: int
    rate: float  # [Hz], NaN where it is not known
    joints: tuple[str, ...]  # none where it was not read
    read: bool


class About(NamedTuple):
    """What is known of a table besides its columns; a table has it as `about`, if at all."""

    notes: tuple[str, ...] = ()
    unstated: frozenset[str] = frozenset()  # columns whose unit the file leaves open
    topics: tuple[Topic, ...] = ()
    clock: str = ""  # what time is that of

    @classmethod
    def of(cls, table: Table) -> About:
        """What a table knows of itself."""
        return getattr(table, "about", cls())


class Format(ABC):
    """One kind of file, or of folder, that holds named columns."""

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

    def select(self, path: Path, topics: Sequence[str]) -> Table:
        """The table of some topics of a log; without topics, what `open` gives.

        Raises:
            OptionError: files of this kind have no topics.
            RecordingError: as of `open`.
        """
        if topics:
            raise OptionError(f"{path} is of the format {self.name}, which has no topics; leave --topic out")
        return self.open(path)

    def files(self, path: Path) -> Sequence[Path]:
        """What of a folder is read; of a file, the file."""
        return [path]

    @property
    def writes(self) -> bool:
        """Whether files of this kind can be written."""
        return type(self).encode is not Format.encode

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

    def __init__(
        self, usable: Mapping[str, Array], unusable: Mapping[str, str], source: str, about: About | None = None
    ) -> None:
        self._usable, self._unusable, self._source = dict(usable), dict(unusable), source
        self.about = about or About()
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
        arrays: each (N,) or (N, n), in the units of the columns of these names [s, rad or m, N.m or N, A]; dates
            become seconds since the first.
        source: what the sentences of errors call it.

    Raises:
        RecordingError: when a matrix stands the wrong way round.
    """
    given = {name: seconds(np.asarray(value)) for name, value in arrays.items()}
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


def seconds(stamps: np.ndarray) -> np.ndarray:
    """Dates as seconds since the first of them, and durations as seconds, to the nanosecond; other arrays as they are.

    Args:
        stamps: (...,) [1] array of any kind.
    """
    if stamps.dtype.kind not in "Mm":
        return stamps
    known = stamps[~np.isnat(stamps)]
    since = stamps - known[0] if stamps.dtype.kind == "M" and len(known) else stamps
    count = since.astype("timedelta64[ns]").astype(np.int64) / 1e9
    return np.where(np.isnat(since), np.nan, count)


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
