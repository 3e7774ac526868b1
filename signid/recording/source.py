"""Open sources of samples: files or folders of a known format, arrays, or frames of pandas, polars or arrow."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from hashlib import file_digest, sha256
from pathlib import Path
from typing import Any, NamedTuple, Protocol, cast

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from ..errors import OptionError, RecordingError, UndecidedReading, readable, shorten
from ..types import Reading, Table
from .formats import find_format
from .formats.base import About, memory_table
from .mapping import DerivedTable, Heading
from .match import guess


class Frame(Protocol):
    """A container of named columns: pandas or polars frame, arrow table, structured array."""

    def __getitem__(self, name: Any, /) -> Any: ...


SUFFIX = ".reading.toml"  # of the name of the log
SECONDS = re.compile(r"(.*?)(?:secs?|seconds)", re.IGNORECASE)  # names of the halves of a stamp
NANOSECONDS = re.compile(r"(.*?)(?:nano_?secs?|nano_?seconds?|nsecs?)", re.IGNORECASE)
Source = str | Path | Mapping[str, ArrayLike] | Frame


class Opened(NamedTuple):
    """A table, its name in messages, and its origin."""

    table: Table
    name: str
    path: str
    sha256: str  # of the bytes of the file or the folder's files, or of the arrays


def open_source(source: Source, topics: Sequence[str] = (), heading: Heading | None = None) -> Opened:
    """Open a file or folder, arrays (N,) or (N, n) by column name, or a frame [s, rad or m, N.m or N, A].

    A rate of `heading` makes the column t, the only one of time.

    `topics` of a log are joined in time; by default, the only suitable one is read. `heading` states lines before the
    header of a file, and names of its columns; arrays and frames have names.

    Raises:
        OptionError: topics of a source without topics.
        RecordingError: missing file, unknown format, or array of a wrong shape.
    """
    stated = heading or Heading()
    if stated.rate is not None:
        unpaced = open_source(source, topics, stated._replace(rate=None))
        left = [name for name in unpaced.table.columns if (meant := guess(name)) and meant.kind == "t"]
        unused = f"; not used: {shorten(left)}" if left else ""
        note = f"times are those of {stated.rate:g} rows a second, as stated{unused}"
        paced = DerivedTable(unpaced.table, {}, {"t": np.arange(unpaced.table.rows) / (stated.rate or 1.0)})
        paced.columns = tuple(name for name in paced.columns if name == "t" or name not in left)
        about = About.of(unpaced.table)
        paced.about = about._replace(notes=(*about.notes, *([note] if stated.rate else [])))
        return unpaced._replace(table=paced)
    if not isinstance(source, str | Path):
        if topics:
            raise OptionError("arrays and frames have no topics; give topics of a ROS bag only")
        columns = columns_of(source)
        digest = sha256()
        for name in sorted(columns):
            column = np.asarray(columns[name])
            plain = np.ascontiguousarray(column).tobytes() if column.dtype != object else repr(column.tolist()).encode()
            digest.update(name.encode() + b"\0" + plain)
        return Opened(memory_table(columns, "the recording"), "the recording", "", digest.hexdigest())
    path = Path(source)
    if not path.is_file() and not path.is_dir():
        raise RecordingError(f"recording {path} does not exist; expected a file of samples")
    form, name, usual = find_format(path), readable(str(path)), stated == Heading()
    if topics and not usual:
        raise OptionError(f"{path} has topics, so it has neither lines before a header nor columns without names")
    table = form.select(path, topics) if usual else form.open_headed(path, stated)
    return Opened(_whole_stamps(table), name, name, digest_of(path))


def _whole_stamps(table: Table) -> Table:
    """A table with stamps [s] where two columns hold their seconds and nanoseconds, as in messages of ROS."""
    heads = {match[1]: name for name in table.columns if (match := SECONDS.fullmatch(name))}
    halves = {name: match[1] for name in table.columns if (match := NANOSECONDS.fullmatch(name)) and match[1] in heads}
    for nanoseconds, head in halves.items() if "t" not in table.columns else []:
        with suppress(RecordingError):  # texts
            whole = table.read([heads[head], nanoseconds], 0, table.rows) @ [1.0, 1e-9]
            return DerivedTable(table, {}, {head.rstrip("._") or "stamp": np.asarray(whole)})
    return table


def digest_of(path: Path) -> str:
    """SHA-256 of a file; for a folder, of the list of its files in the format of sha256sum (`sha256  name`).

    Raises:
        RecordingError: unreadable file.
    """
    files = find_format(path).files(path) if path.is_dir() else [path]
    try:
        digests = []
        for file in files:
            if file.exists() and not file.is_file():
                raise RecordingError(f"recording {path} cannot be read: it is no regular file")
            with file.open("rb") as stream:
                digests.append(file_digest(stream, "sha256").hexdigest())
    except OSError as error:
        raise RecordingError(f"recording {path} cannot be read: {error.strerror}") from error
    if not path.is_dir():
        return digests[0]
    lines = (
        f"{digest}  {readable(file.relative_to(path).as_posix())}\n"
        for file, digest in zip(files, digests, strict=True)
    )
    return sha256("".join(lines).encode()).hexdigest()


def columns_of(source: Mapping[str, ArrayLike] | Frame) -> Mapping[str, ArrayLike]:
    """Columns by name; an index of dates or durations, or named t, becomes column t if there is none.

    Raises:
        RecordingError: the source is no frame, or two columns have the same name.
    """
    if isinstance(source, Mapping):
        return source
    if isinstance(source, np.ndarray) and source.dtype.names:
        return {name: source[name] for name in source.dtype.names}
    if hasattr(source, "iloc") and hasattr(source, "columns"):
        frame: Any = source
        names = [str(name) for name in frame.columns]
        if (twice := next((name for name in names if names.count(name) > 1), None)) is not None:
            raise RecordingError(f"the frame has two columns {twice!r}; give every column its own name")
        columns = {name: _numbers(frame.iloc[:, k]) for k, name in enumerate(names)}
        index = frame.index
        if "t" not in columns and (index.name == "t" or getattr(index.dtype, "kind", "") in "mM"):
            columns["t"] = _numbers(index)
        return columns
    if isinstance(source, pl.LazyFrame):
        source = source.collect()
    elif hasattr(source, "__arrow_c_stream__") and not isinstance(source, pl.DataFrame):
        with suppress(pl.exceptions.PolarsError):  # a single column is no frame
            source = pl.DataFrame(cast(Any, source))
    if isinstance(source, pl.DataFrame):
        return {column.name: column.to_numpy() for column in source}
    expected = "expected a file, arrays by column name, or a frame of pandas, polars or arrow"
    raise RecordingError(f"a recording cannot be read from {type(source).__name__}; {expected}")


def _numbers(series: Any) -> ArrayLike:
    """Numbers, dates or durations as a numpy array; missing values are NaN."""
    kind = getattr(series.dtype, "kind", "O")
    if kind in ("M", "m"):
        return np.asarray(series.to_numpy(dtype=f"{'datetime64' if kind == 'M' else 'timedelta64'}[ns]"))
    if kind in ("b", "i", "u", "f"):
        return np.asarray(series.to_numpy(dtype=np.float64, na_value=np.nan))
    return np.asarray(series.to_numpy(dtype=object))


def reading_beside(source: object, folder: str | Path | None = None) -> Path | None:
    """The reading of a log that lies beside it, or in a folder; None without one."""
    paths = [reading_path(source, place) for place in (None, folder)] if isinstance(source, str | Path) else []
    return next((path for path in paths if path.is_file()), None)


def found_reading(file: object) -> Reading | None:
    """The reading in a file with a column map; None for another map.

    Raises:
        UndecidedReading: lines of it are still to be chosen.
    """
    if not isinstance(file, str | Path) or not str(file).endswith(SUFFIX):
        return None
    reading, name = Reading(Path(file).read_text(encoding="utf-8"), (), readable(str(file))), readable(str(file))
    if offered := re.findall(r"^#\s*(\S.*?)\s*# which\?", reading.text, re.MULTILINE):
        fact = f"{name.removesuffix(SUFFIX)}: lines of its reading are to be chosen: {shorten(offered, 3)}"
        raise UndecidedReading(f"{fact} (remove the first # of each line that is right, delete the others)", "")
    return reading


def reading_path(source: str | Path, folder: str | Path | None = None) -> Path:
    """Path of the reading of a log, beside it or in a folder."""
    path = Path(source)
    return (path.parent if folder is None else Path(folder)) / f"{path.name}{SUFFIX}"
