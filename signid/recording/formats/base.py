"""Interface of the file formats, tables of arrays in memory and its limits, and panics of polars."""

from __future__ import annotations

import os
import sys
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from ...errors import OptionError, RecordingError, shorten
from ...types import Array, Table
from ..mapping import Heading
from ..match import guess

MOST_DEPTH = 20  # groups inside each other
NUMBERS, DATES = "biuf", "mM"  # kinds of data types
MAX_UNPACKED = 8_000_000_000  # maximum uncompressed size of a file that is read completely [bytes]
MOST_COLUMNS = 20_000  # of a table
MOST_PARTS = 1000  # numbers of a list that becomes columns; longer ones are images or scans
_MEMORY, _OWN = Path("/proc/meminfo"), Path("/proc/self/statm")  # of Linux
_LIMITED = Lock()
BROKEN = (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError)
_lock, _inside, _kept = Lock(), 0, -1


def memory_table(arrays: Mapping[str, Any], source: str, about: About | None = None) -> MemoryTable:
    """Table of arrays (N,) by name; groups, by name or as structured arrays, are NAME.FIELD.

    Dates become seconds since the first. A matrix "q" (N, n) or (n, N) becomes the columns q_1 to q_n: N is the size of
    the time t, else of an array that is named like a time, else the longest axis of all.

    Raises:
        RecordingError: a square matrix whose rows and columns could both be samples, too many columns or groups, or
            more numbers than memory holds.
    """
    named: dict[str, np.ndarray] = {}
    for name, value in _leaves(arrays, "", source, 0):
        if name in named:
            raise RecordingError(f"{source} has two arrays {name!r}; give every array its own name")
        array = np.asarray(value)
        if np.ma.isMaskedArray(value) and array.dtype.kind in NUMBERS:
            array = np.ma.filled(value.astype(np.float64), np.nan)  # masked values are missing
        if array.dtype.kind not in DATES:
            named[name] = array
        else:
            known = array[~np.isnat(array)]
            since = array - known[0] if array.dtype.kind == "M" and len(known) else array
            count = since.astype("timedelta64[ns]").astype(np.int64) / 1e9
            named[name] = np.where(np.isnat(since), np.nan, count)
    reference, rows = _samples(named)
    columns: dict[str, np.ndarray] = {}
    for name, value in named.items():
        for column, part in _columns(name, value, rows, source):
            if column in columns:
                raise RecordingError(f"{source} has two columns {column!r}; give every array its own name")
            columns[column] = part
        if len(columns) > MOST_COLUMNS:
            raise RecordingError(f"{source} has more than {MOST_COLUMNS} columns; save only those of the robot")
    faults = {name: fault for name, column in columns.items() if (fault := _fault(column, reference, rows))}
    require_memory(source, 8.0 * rows * (len(columns) - len(faults)))  # small integers become floats
    usable = {name: np.array(column, np.float64) for name, column in columns.items() if name not in faults}
    if deep := [name for name, column in columns.items() if column.ndim > 2 and column.dtype.kind in NUMBERS]:
        name = next(filter(_signal, deep), deep[0])
        shape = columns[name].shape
        if _signal(name) and not any(map(_signal, usable)):
            fault = f"{name!r} has {len(shape)} dimensions, {' x '.join(map(str, shape))}, and rows need one or two"
            advice = "save each repetition, or all samples one after another, as a matrix (samples, joints)"
            raise RecordingError(f"{source}: {fault}; {advice}, by numpy.savez or save -v7")
        about = about or About()
        note = f"arrays of more than two dimensions are not read: {shorten(deep)}; save matrices (samples, joints)"
        about = about._replace(notes=(*about.notes, note))
    return MemoryTable(usable, faults, source, about)


def _signal(name: str) -> bool:
    meant = guess(name)
    return meant is not None and meant.kind != "t"


def _leaves(group: Any, name: str, source: str, depth: int) -> Iterator[tuple[str, ArrayLike]]:
    """Arrays of a group and of the groups in it."""
    if depth > MOST_DEPTH:
        raise RecordingError(f"{source} is nested more than {MOST_DEPTH} deep; save its arrays side by side")
    fields = group if isinstance(group, Mapping) else {}
    if isinstance(group, np.ndarray) and group.dtype.names:
        fields = {field: group[field] for field in group.dtype.names}
    elif not isinstance(group, Mapping):
        yield name, group
    for field, value in fields.items():
        yield from _leaves(value, f"{name}.{field}" if name else str(field), source, depth + 1)


def _samples(arrays: Mapping[str, np.ndarray]) -> tuple[str, int]:
    """Array that defines the number of samples, and this number."""
    numbers = {name: value for name, value in arrays.items() if value.dtype.kind in NUMBERS}
    vectors = {name: value.size for name, value in numbers.items() if 0 < value.ndim < 3 and value.size in value.shape}
    if "t" in vectors:
        return "t", vectors["t"]
    times = [name for name in vectors if vectors[name] > 1 and (meant := guess(name)) and meant.kind == "t"]
    if times:
        longest = max(times, key=lambda name: vectors[name])
        return longest, vectors[longest]
    axes = {name: max(value.shape) for name, value in numbers.items() if 0 < value.ndim < 3}
    longest = max(axes, key=lambda name: axes[name], default="t")
    return longest, axes.get(longest, 0)


def _columns(name: str, value: np.ndarray, rows: int, source: str) -> Iterator[tuple[str, np.ndarray]]:
    """Columns of an array; one that is no matrix of the samples is its own."""
    if name == "t" and value.ndim == 2 and value.size in value.shape:
        yield name, value.ravel()
        return
    if value.ndim != 2 or value.dtype.kind not in NUMBERS or rows not in value.shape:
        yield name, value
        return
    if value.shape[0] == value.shape[1] > 1:
        fault = f"{name!r} has as many rows as columns, {rows}, so that either could be the samples"
        raise RecordingError(f"{source}: {fault}; save each column as an array of its own, {name}_1, {name}_2, ...")
    matrix = value if value.shape[0] == rows else value.T
    if matrix.shape[1] > MOST_PARTS:
        yield name, value
        return
    yield from ((f"{name}_{k}", part) for k, part in enumerate(matrix.T, 1))


def _fault(column: np.ndarray, reference: str, rows: int) -> str:
    """Reason why an array is not a numeric column, "" if it is one."""
    if column.dtype.kind not in NUMBERS:
        return "holds no plain numbers; give one real number per sample"
    if column.ndim != 1:
        return f"has shape {column.shape}, expected one value per sample"
    return "" if len(column) == rows else f"has {len(column)} values, expected {rows} as {reference!r} has"


class Topic(NamedTuple):
    """A topic of a log."""

    name: str
    kind: str  # "sensor_msgs/msg/JointState"
    messages: int
    rate: float  # [Hz], NaN if unknown
    joints: tuple[str, ...]  # empty if the topic was not read
    read: bool


class About(NamedTuple):
    """Metadata of a table, its optional attribute `about`."""

    notes: tuple[str, ...] = ()
    unstated: frozenset[str] = frozenset()  # columns without a stated unit
    topics: tuple[Topic, ...] = ()
    clock: str = ""  # source of the time column
    origin: float = 0.0  # [s] time at which the time column is 0: of dates, since 1970
    episodes: tuple[tuple[float, str], ...] = ()  # first time [s] and name of each, if the source has episodes

    @classmethod
    def of(cls, table: Table) -> About:
        """Metadata of a table; empty if it has none."""
        return getattr(table, "about", None) or cls()


class Format(ABC):
    """A kind of file or folder with named columns."""

    name: str
    suffixes: tuple[str, ...]  # lower case, with the dot: (".csv", ".csv.gz")
    description: str

    def recognises(self, path: Path) -> bool:
        """Whether a file has this format, by its name."""
        return path.name.lower().endswith(self.suffixes)

    @abstractmethod
    def open(self, path: Path) -> Table:
        """Open a file as a table.

        Raises:
            RecordingError: the file is not a valid table of this format.
        """

    def select(self, path: Path, topics: Sequence[str]) -> Table:
        """Open topics of a log as a table; without topics, the same as `open`.

        Raises:
            OptionError: the format has no topics.
            RecordingError: as for `open`.
        """
        if topics:
            raise OptionError(f"{path} has the format {self.name}, which has no topics; remove --topic")
        return self.open(path)

    def open_headed(self, path: Path, heading: Heading) -> Table:
        """Open a file of which lines before the header, or the names of the columns, are stated.

        Raises:
            OptionError: the format names its columns itself.
            RecordingError: as for `open`.
        """
        advice = "remove skip and names from the column map or the command"
        raise OptionError(f"{path} has the format {self.name}, which names its columns itself; {advice}")

    def files(self, path: Path) -> Sequence[Path]:
        """Files that are read from a folder; a file itself."""
        return [path]

    @property
    def writes(self) -> bool:
        """Whether the format supports writing."""
        return type(self).encode is not Format.encode

    def encode(self, columns: Mapping[str, Array], file: str) -> bytes:
        """Encode columns, (N,) each [s, rad or m, N.m or N], as the content of a file of a name, deterministically.

        Raises:
            OptionError: the format does not support writing.
        """
        raise OptionError(f"files of the format {self.name} cannot be written; write .csv or .parquet")


class MemoryTable:
    """Columns in memory; reading an unusable column raises an error with its reason."""

    def __init__(
        self, usable: Mapping[str, Array], unusable: Mapping[str, str], source: str, about: About | None = None
    ) -> None:
        self._usable, self._unusable, self._source = dict(usable), dict(unusable), source
        self.about = about or About()
        self.columns = (*self._usable, *self._unusable)
        self.rows = min((len(column) for column in self._usable.values()), default=0)

    def read(self, names: Sequence[str], start: int, stop: int) -> Array:
        """Read rows start..stop of the named columns, (stop - start, len(names)), NaN where empty.

        Raises:
            RecordingError: missing or non-numeric column.
        """
        for name in names:
            if name not in self._usable:
                raise RecordingError(refusal(self._source, name, self._unusable.get(name), self.columns))
        result = np.empty((len(names), max(0, min(stop, self.rows) - start)))
        for i, name in enumerate(names):
            result[i] = self._usable[name][start:stop]
        return result.T


def refusal(source: str, column: str, reason: str | None, columns: Sequence[str]) -> str:
    """Error message for an unusable column, or without a reason for a missing one."""
    if reason:
        return f"{source}: column {column!r} {reason}"
    return f"{source} has no column {column!r}; it has {', '.join(columns[:12])}{', ...' if len(columns) > 12 else ''}"


def require_memory(path: str | Path, size: float, advice: str = "give it as Parquet, which is read in chunks") -> None:
    """Reject a file that does not fit into memory; `size` is what reading it requires [bytes].

    Raises:
        RecordingError: not enough memory.
    """
    free = free_memory()
    if size > free:
        fault = f"reading {path} needs about {size / 1e9:.2g} GB of memory, but only {free / 1e9:.2g} GB are free"
        raise RecordingError(f"{fault}; {advice}")


def free_memory() -> float:
    """Free memory for this process; infinite if unknown [bytes]."""
    limits = [float("inf")]
    if _MEMORY.is_file():
        lines = _MEMORY.read_text(encoding="utf-8").splitlines()
        limits += [1024.0 * float(line.split()[1]) for line in lines if "MemAvailable" in line]
    try:
        import resource
    except ImportError:  # Windows
        return min(limits)
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and _OWN.is_file():
        limits.append(max(0.0, limit - _used()))
    return min(limits)


@contextmanager
def memory_limited() -> Iterator[None]:
    """Raise MemoryError for requests beyond the free memory, where Linux would kill the process; only on Linux.

    A few bytes of a compressed log can expand to any size, and libraries do not check it.
    """
    free = free_memory()
    if free == float("inf") or not _OWN.is_file():
        yield
        return
    import resource

    with _LIMITED:
        limits = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (int(_used() + free), limits[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_AS, limits)


def _used() -> int:
    """Address space of this process [bytes]."""
    import resource

    return int(_OWN.read_text(encoding="utf-8").split()[0]) * resource.getpagesize()


@contextmanager
def hushed() -> Iterator[None]:
    """Discard what is printed to the standard error of the process; it may be entered by several threads."""
    global _inside, _kept
    with _lock:
        _inside += 1
        if _inside == 1:
            with suppress(OSError, ValueError):  # closed streams
                sys.stderr.flush()
            with suppress(OSError):
                _kept = os.dup(2)
                with open(os.devnull, "wb") as null:
                    os.dup2(null.fileno(), 2)
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if _inside == 0 and _kept >= 0:
                os.dup2(_kept, 2)
                os.close(_kept)
                _kept = -1
