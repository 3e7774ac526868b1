"""Where samples come from: a file or folder of a known format, or arrays or a frame in memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from hashlib import file_digest, sha256
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import OptionError, RecordingError
from ..types import Table
from .formats.base import memory_table
from .formats.find import find_format
from .frames import Frame, columns_of

Source = str | Path | Mapping[str, ArrayLike] | Frame


class Opened(NamedTuple):
    """A table, what sentences call it, and where it came from."""

    table: Table
    name: str
    path: str
    sha256: str  # of the bytes of the file or the folder's files, or of the arrays


def open_source(source: Source, topics: Sequence[str] = ()) -> Opened:
    """The table of a file or folder, of arrays by name, or of a frame of pandas, polars or arrow.

    Args:
        source: a file or folder, arrays (N,) or (N, n) by column name, or a frame [s, rad or m, N.m or N, A].
        topics: of a log, which are read and joined in time; without them, the only one that fits.

    Raises:
        OptionError: topics of something that has none.
        RecordingError: there is no such file, or no format reads it, or an array has a wrong shape.
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
    """The sha256 of a file, or of a folder's list of what is read of it: a line `sha256  name` for each, as sha256sum.

    Raises:
        RecordingError: a file cannot be read.
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
