"""Interface of the file formats, tables in memory and its limits, and panics of polars."""

from __future__ import annotations

import os
import sys
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Lock
from typing import NamedTuple

import numpy as np
import polars as pl

from ...errors import OptionError, RecordingError
from ...types import Array, Table
from ..names.mapping import Heading

MOST = 8_000_000_000  # maximum uncompressed size of a file that is read completely [bytes]
MOST_COLUMNS = 20_000  # of a table
MOST_PARTS = 1000  # numbers of a list that becomes columns; longer ones are images or scans
_MEMORY, _OWN = Path("/proc/meminfo"), Path("/proc/self/statm")  # of Linux
_LIMITED = Lock()
BROKEN = (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError)

_lock, _inside, _kept = Lock(), 0, -1


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
        advice = "remove skip and names from the column map, or --skip and --names"
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
    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    if most != resource.RLIM_INFINITY and _OWN.is_file():
        limits.append(max(0.0, most - _used()))
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
    _enter()
    try:
        yield
    finally:
        _leave()


def _enter() -> None:
    global _inside, _kept
    with _lock:
        _inside += 1
        if _inside == 1:
            with suppress(OSError, ValueError):  # closed streams
                sys.stderr.flush()
            with suppress(OSError):
                _kept = os.dup(2)
                null = os.open(os.devnull, os.O_WRONLY)
                os.dup2(null, 2)
                os.close(null)


def _leave() -> None:
    global _inside, _kept
    with _lock:
        _inside -= 1
        if _inside == 0 and _kept >= 0:
            os.dup2(_kept, 2)
            os.close(_kept)
            _kept = -1
