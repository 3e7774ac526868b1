"""Arrow tables in files: Feather, and Arrow IPC as a file or a stream."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import polars as pl

from ...errors import RecordingError
from ...types import Table
from .base import BROKEN, Format, hushed, require_memory
from .parquet import ScannedTable

FILE, FIRST = b"ARROW1", b"FEA1"  # beginnings of a file, which is not a stream, and of Feather of version 1
CONTINUED = 0xFFFFFFFF  # mark before the length of a message
DICTIONARY, BATCH = 2, 3  # kinds of messages with data
TIMES = 3  # peak memory while reading [times the size of the numbers]


class Arrow(Format):
    """Read completely."""

    name, suffixes = "arrow", (".feather", ".arrow", ".arrows", ".ipc")
    description = "Feather and Arrow IPC, file or stream"

    def open(self, path: Path) -> Table:
        try:
            require_memory(path, path.stat().st_size)
            content = path.read_bytes()
            if content.startswith(FIRST):
                fault = f"{path} is Feather of version 1, which is no longer read"
                raise RecordingError(f"{fault}; write it again as Feather of version 2 or as Parquet")
            sizes: list[float] = []
            for place, body in _blocks(content) if content.startswith(FILE) else _messages(content):
                message = _Tables(content, place)
                kind, header = message.integer("<B", message.root, 1), message.table(message.root, 2)
                if kind == DICTIONARY:
                    header = message.table(header, 1)
                elif kind != BATCH:
                    continue
                sizes.append(8.0 * message.integer("<q", header, 0))
                packed = message.field(header, 3)
                for offset, size in message.structures(header, 2, "<qq"):
                    stated = struct.unpack_from("<q", content, body + offset)[0] if packed and size >= 8 else 0
                    sizes.append(float(max(size, stated)))
            require_memory(path, TIMES * sum(sizes))
            with hushed():
                frame = pl.read_ipc(content) if content.startswith(FILE) else pl.read_ipc_stream(content)
                require_memory(path, 8.0 * frame.height * frame.width)
                return ScannedTable(path, frame.lazy())
        except (*BROKEN, struct.error, OverflowError) as error:
            raise RecordingError(f"{path} is not an Arrow table, or is cut short; copy or write it again") from error


def _blocks(content: bytes) -> Iterator[tuple[int, int]]:
    """Places of the messages and bodies of a file, which its end states."""
    (size,) = struct.unpack_from("<I", content, len(content) - len(FILE) - 4)
    footer = _Tables(content, len(content) - len(FILE) - 4 - size)
    for vector in (2, 3):
        for place, length, _ in footer.structures(footer.root, vector, "<qi4xq"):
            start, _ = _prefix(content, place)
            yield start, place + length


def _messages(content: bytes) -> Iterator[tuple[int, int]]:
    """Places of the messages and bodies of a stream."""
    place = 0
    while place + 4 <= len(content):
        start, size = _prefix(content, place)
        if not size:
            return
        message, place = _Tables(content, start), start + size
        yield start, place
        body = message.integer("<q", message.root, 3)
        if body < 0:
            raise struct.error("negative size")
        place += body


def _prefix(content: bytes, place: int) -> tuple[int, int]:
    """Place of a message behind its length, and the length."""
    (size,) = _unpack("<I", content, place)
    return (place + 8, _unpack("<I", content, place + 4)[0]) if size == CONTINUED else (place + 4, size)


def _unpack(form: str, content: bytes, place: int) -> tuple[int, ...]:
    if place < 0:
        raise struct.error("negative place")
    return struct.unpack_from(form, content, place)


class _Tables:
    """FlatBuffers of a message: a table begins with the distance to the places of its fields."""

    def __init__(self, content: bytes, start: int) -> None:
        self._content, self.root = content, start + _unpack("<I", content, start)[0]

    def field(self, table: int, number: int) -> int:
        """Place of a field; 0 if it has its default."""
        places = table - _unpack("<i", self._content, table)[0]
        if 4 + 2 * number >= _unpack("<H", self._content, places)[0]:
            return 0
        (distance,) = _unpack("<H", self._content, places + 4 + 2 * number)
        return table + distance if distance else 0

    def integer(self, form: str, table: int, number: int) -> int:
        """Number in a field."""
        place = self.field(table, number)
        return _unpack(form, self._content, place)[0] if place else 0

    def table(self, table: int, number: int) -> int:
        """Place of the table in a field."""
        place = self.field(table, number)
        if not place:
            raise struct.error("missing table")
        return place + _unpack("<I", self._content, place)[0]

    def structures(self, table: int, number: int, form: str) -> Iterator[tuple[int, ...]]:
        """Numbers of each structure of the vector in a field."""
        if not self.field(table, number):
            return
        vector = self.table(table, number)
        for k in range(_unpack("<I", self._content, vector)[0]):
            yield _unpack(form, self._content, vector + 4 + struct.calcsize(form) * k)


PLUGIN = Arrow()
