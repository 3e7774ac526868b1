"""Where samples come from: a file of a known format, or arrays in memory."""

from __future__ import annotations

from collections.abc import Mapping
from hashlib import file_digest, sha256
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import RecordingError
from ..formats.base import memory_table
from ..formats.find import find_format
from ..types import Table

Source = str | Path | Mapping[str, ArrayLike]


class Opened(NamedTuple):
    """A table, what sentences call it, and where it came from."""

    table: Table
    name: str
    path: str
    sha256: str  # of the bytes of the file, or of the arrays


def open_source(source: Source) -> Opened:
    """The table of a file or of arrays by name.

    Args:
        source: a file, or arrays (N,) or (N, n) by column name [s, rad or m, N.m or N, A].

    Raises:
        RecordingError: there is no such file, or no format reads it, or an array has a wrong shape.
    """
    if isinstance(source, Mapping):
        digest = sha256()
        for name in sorted(source):
            digest.update(name.encode() + b"\0" + np.ascontiguousarray(source[name]).tobytes())
        return Opened(memory_table(source, "the recording"), "the recording", "", digest.hexdigest())
    path = Path(source)
    if not path.is_file():
        fault = "is a folder" if path.is_dir() else "does not exist"
        raise RecordingError(f"recording {path} {fault}; expected a file of samples")
    table = find_format(path).open(path)
    try:
        with path.open("rb") as stream:
            return Opened(table, str(path), str(path), file_digest(stream, "sha256").hexdigest())
    except OSError as error:
        raise RecordingError(f"recording {path} cannot be read: {error.strerror}") from error
