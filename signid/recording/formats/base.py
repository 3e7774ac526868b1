"""Interface of the file formats, tables in memory, and its limits."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...errors import OptionError, RecordingError
from ...types import Array, Table
from ..names.mapping import Heading

MOST = 8_000_000_000  # maximum uncompressed size of a file that is read completely [bytes]
_MEMORY, _OWN = Path("/proc/meminfo"), Path("/proc/self/statm")  # of Linux
_LIMITED = Lock()


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

    @classmethod
    def of(cls, table: Table) -> About:
        """Metadata of a table; empty if it has none."""
        return getattr(table, "about", cls())


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


def memory_table(arrays: Mapping[str, ArrayLike], source: str) -> MemoryTable:
    """Table of arrays (N,) by name; dates become seconds since the first, a matrix "q" (N, n) the columns q_1 to q_n.

    Raises:
        RecordingError: transposed matrix.
    """
    given = {name: _seconds(np.asarray(value)) for name, value in arrays.items()}
    columns: dict[str, np.ndarray] = {}
    for name, value in given.items():
        if value.ndim == 2 and 1 < value.shape[1] == np.size(given.get("t", ())) != value.shape[0]:
            fault = f"has shape {value.shape}, expected {value.shape[::-1]}, a row for each sample; transpose it"
            raise RecordingError(f"{source}: {name!r} {fault}")
        if value.ndim == 2 and name != "t":
            columns.update({f"{name}_{k + 1}": value[:, k] for k in range(value.shape[1])})
        else:
            columns[name] = value.ravel() if name == "t" else value
    sizes = {name: len(column) for name, column in columns.items() if column.ndim == 1}
    longest = "t" if "t" in sizes else max(sizes, key=lambda each: sizes[each], default="t")
    rows = sizes.get(longest, 0)
    faults = {name: fault for name, column in columns.items() if (fault := _fault(column, longest, rows))}
    usable = {name: np.array(column, np.float64) for name, column in columns.items() if name not in faults}
    return MemoryTable(usable, faults, source)


def _seconds(stamps: np.ndarray) -> np.ndarray:
    """Dates as seconds since the first one, and durations as seconds; other arrays are unchanged."""
    if stamps.dtype.kind not in "Mm":
        return stamps
    known = stamps[~np.isnat(stamps)]
    since = stamps - known[0] if stamps.dtype.kind == "M" and len(known) else stamps
    count = since.astype("timedelta64[ns]").astype(np.int64) / 1e9
    return np.where(np.isnat(since), np.nan, count)


def _fault(column: np.ndarray, reference: str, rows: int) -> str:
    """Reason why an array is not a numeric column, "" if it is one."""
    if column.dtype.kind not in "biuf":
        return "holds no plain numbers; give one real number per sample"
    if column.ndim != 1:
        return f"has shape {column.shape}, expected one value per sample"
    return "" if len(column) == rows else f"has {len(column)} values, expected {rows} as {reference!r} has"


def require_memory(path: Path, size: float, advice: str = "give it as Parquet, which is read in chunks") -> None:
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
