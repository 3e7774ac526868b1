"""MATLAB files: arrays and structures of arrays, by SciPy; those of version 7.3 are HDF5."""

from __future__ import annotations

import struct
import warnings
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...errors import RecordingError
from ...types import Table
from .base import MAX_UNPACKED, MOST_DEPTH, MOST_PARTS, Format, free_memory, memory_limited, require_memory
from .hdf5 import open_hdf5, without_objects

HEADER = 128  # length of the header [bytes]
MATRIX, COMPRESSED = 14, 15  # kinds of elements
CELL, STRUCT, OBJECT, OPAQUE = 1, 2, 3, 17  # classes of arrays
NUMBERS = range(6, 16)  # classes of arrays of numbers
NAMES_BEFORE = {CELL: 0, STRUCT: 2, OBJECT: 3}  # elements before the arrays inside an array
HDF5 = 2  # major version of files that are HDF5
TIMES = 3  # peak memory while reading [times the size of the file without compression]


class Matlab(Format):
    """Read completely; a structure becomes NAME.FIELD, elements of an array of structures NAME_1 and so on."""

    name, suffixes = "matlab", (".mat",)
    description = "MATLAB file of arrays and structures"

    def open(self, path: Path) -> Table:
        from scipy.io.matlab import loadmat, matfile_version  # slow import

        try:
            require_memory(path, TIMES * path.stat().st_size)
            content = path.read_bytes()
            version, _ = matfile_version(BytesIO(content))
            if version == HDF5:
                return open_hdf5(path)
            objects: list[str] = []
            if version:
                content, objects = _readable(content)
            with memory_limited(), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                variables = loadmat(BytesIO(content), struct_as_record=True, chars_as_strings=True)
        except RecordingError:
            raise
        except MemoryError as error:
            raise RecordingError(f"{path} needs more memory than there is, or is damaged; save fewer arrays") from error
        except Exception as error:  # headers and elements raise many types
            sentence = f"{path} is not a MATLAB file, or is damaged; save its arrays again with save -v7"
            raise RecordingError(sentence) from error
        names = [name for name in variables if not name.startswith("__")]
        arrays: dict[str, Any] = {}
        for name, value in (part for variable in names for part in _parts(variable, variables[variable], 0)):
            if name in arrays:
                raise RecordingError(f"{path} has two arrays {name!r}; give every array its own name")
            arrays[name] = value
        return without_objects(path, arrays, objects)


class _Element(NamedTuple):
    """An element of a file."""

    kind: int
    start: int  # of its data
    stop: int
    end: int  # with padding


def _readable(content: bytes) -> tuple[bytes, list[str]]:
    """File without compression that holds arrays of numbers and structures only, and the names of objects left out.

    SciPy ends the process at arrays nested without end, and some of its functions fail at objects.

    Raises:
        ValueError: damaged or nested too deeply.
        MemoryError: more data than memory holds.
    """
    order = {b"IM": "<", b"MI": ">"}[content[HEADER - 2 : HEADER]]
    limit = min(MAX_UNPACKED, free_memory() / TIMES)
    kept, names, objects, place, size = [content[:HEADER]], list[bytes](), list[str](), HEADER, 0
    while place + 8 <= len(content):
        outer = _element(content, place, order)
        place = outer.stop if outer.kind == COMPRESSED else outer.end
        whole = content[outer.start - 8 : outer.stop]
        if outer.kind == COMPRESSED:
            packed = zlib.decompressobj()
            whole = packed.decompress(content[outer.start : outer.stop], int(limit - size) + 1)
            if not packed.eof and size + len(whole) <= limit:
                raise ValueError("cut short")
        size += len(whole)
        if size > limit:
            raise MemoryError
        inner = _element(whole, 0, order)
        if inner.kind != MATRIX or inner.stop > len(whole):
            raise ValueError("no array")
        kind, parts = _array(whole, inner, order)
        if kind == OPAQUE:
            name, _, what, *_ = (whole[part.start : part.stop].decode("utf-8", "replace") for part in parts[1:4])
            objects.append(f"{what} {name}")
        elif kind == STRUCT or kind in NUMBERS:
            names.append(whole[parts[2].start : parts[2].stop])
            waiting = [(inner, 0)]
            while waiting:
                whole_part, depth = waiting.pop()
                if depth > MOST_DEPTH:
                    raise ValueError("nested too deeply")
                class_, elements = _array(whole, whole_part, order)
                if class_ in NAMES_BEFORE:
                    within = elements[3 + NAMES_BEFORE[class_] :]
                    waiting += [
                        (part, depth + 1) for part in within if part.kind == MATRIX and part.stop <= whole_part.stop
                    ]
            kept.append(whole[: inner.end])
    if len({*names}) < len(names):
        raise ValueError("a name twice")
    return b"".join(kept), objects


def _element(content: bytes, place: int, order: str) -> _Element:
    (word,) = struct.unpack_from(f"{order}I", content, place)
    if word >> 16:  # up to four bytes beside the tag
        return _Element(word & 0xFFFF, place + 4, place + 4 + (word >> 16), place + 8)
    (size,) = struct.unpack_from(f"{order}I", content, place + 4)
    return _Element(word, place + 8, place + 8 + size, place + 8 + -(-size // 8) * 8)


def _array(content: bytes, array: _Element, order: str) -> tuple[int, list[_Element]]:
    """Class of an array, and its elements: flags, dimensions, name, then names and arrays, or numbers."""
    parts, place = [], array.start
    while place + 8 <= array.stop:
        parts.append(_element(content, place, order))
        place = parts[-1].end
    if not parts:
        return CELL, []  # empty
    (flags,) = struct.unpack_from(f"{order}I", content, parts[0].start)
    return flags & 0xFF, parts


def _parts(name: str, value: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """Arrays of a variable by name; a text in place of what holds no numbers."""
    if type(value) is not np.ndarray or depth > MOST_DEPTH:  # functions, objects, sparse matrices
        yield name, ""
    elif value.dtype.names and value.size <= MOST_PARTS:
        for k, structure in enumerate(value.flat, 1):
            for field in value.dtype.names:
                part = f"{name}.{field}" if value.size == 1 else f"{name}_{k}.{field}"
                yield from _parts(part, structure[field], depth + 1)
    else:
        yield name, "" if value.dtype.hasobject else np.squeeze(value)


PLUGIN = Matlab()
