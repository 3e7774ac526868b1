"""Open sources of samples: files or folders of a known format, arrays, or frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from hashlib import file_digest, sha256
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import OptionError, RecordingError
from ..types import Table
from .formats import find_format
from .formats.base import memory_table
from .frames import Frame, columns_of

Source = str | Path | Mapping[str, ArrayLike] | Frame


class Opened(NamedTuple):
    """A table, its name in messages, and its origin."""

    table: Table
    name: str
    path: str
    sha256: str  # of the bytes of the file or the folder's files, or of the arrays


def open_source(source: Source, topics: Sequence[str] = ()) -> Opened:
    """Open a file or folder, arrays by name, or a frame of pandas, polars or arrow.

    Args:
        source: a file or folder, arrays (N,) or (N, n) by column name, or a frame [s, rad or m, N.m or N, A].
        topics: topics of a log, joined in time; by default the only suitable one.

    Raises:
        OptionError: topics of a source without topics.
        RecordingError: missing file, unknown format, or array of a wrong shape.
    """
    if not isinstance(source, str | Path):
        if topics:
            raise OptionError("arrays and frames have no topics; give topics of a ROS bag only")
        columns = columns_of(source)
        digest = sha256()
        for name in sorted(columns):
            digest.update(name.encode() + b"\0" + _bytes(np.asarray(columns[name])))
        return Opened(memory_table(columns, "the recording"), "the recording", "", digest.hexdigest())
    path = Path(source)
    if not path.is_file() and not path.is_dir():
        raise RecordingError(f"recording {path} does not exist; expected a file of samples")
    return Opened(find_format(path).select(path, topics), str(path), str(path), digest_of(path))


def digest_of(path: Path) -> str:
    """SHA-256 of a file; for a folder, of the list of its files in the format of sha256sum (`sha256  name`).

    Raises:
        RecordingError: unreadable file.
    """
    files = find_format(path).files(path) if path.is_dir() else [path]
    try:
        digests = {file.as_posix(): _digest(file) for file in files}
    except OSError as error:
        raise RecordingError(f"recording {path} cannot be read: {error.strerror}") from error
    if not path.is_dir():
        return next(iter(digests.values()))
    lines = (f"{digest}  {Path(name).relative_to(path).as_posix()}\n" for name, digest in digests.items())
    return sha256("".join(lines).encode()).hexdigest()


def _bytes(column: np.ndarray) -> bytes:
    return repr(column.tolist()).encode() if column.dtype == object else np.ascontiguousarray(column).tobytes()


def _digest(file: Path) -> str:
    with file.open("rb") as stream:
        return file_digest(stream, "sha256").hexdigest()
