"""Text tables separated by comma, semicolon or tab, plain or gzip-compressed."""

from __future__ import annotations

import csv
import gzip
import io
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from inspect import signature
from itertools import islice
from pathlib import Path
from typing import Any
from zlib import error as ZlibError

import numpy as np
import polars as pl

from ...errors import RecordingError
from ...types import Array, Table
from .base import MOST, Format, MemoryTable, free_memory, require_memory
from .panics import hushed

SEPARATORS = ",;\t"
MOST_HEADER, MOST_BLANK, MOST_COLUMNS = 1_000_000, 10_000, 20_000  # bytes, lines before a header, columns
MOST_NEWLINES = 1_000_000  # size from which on a text of empty lines is refused [bytes]
TIMES = 3  # peak memory while reading [times the size of the text]
BROKEN = (pl.exceptions.PolarsError, pl.exceptions.PanicException)
# texts of missing values, in addition to empty cells and NaN
MISSING = ["NA", "N/A", "null", "NULL", "None", "none", "-nan", "-NaN", "nan(ind)", "-nan(ind)"]
FILL: Any = {"missing_columns": "insert"} if "missing_columns" in signature(pl.read_csv).parameters else {}


@dataclass(frozen=True)
class _Layout:
    """Header of a table."""

    names: tuple[str, ...]
    separator: str
    skip: int  # lines before the first sample
    decimal_comma: bool


class Csv(Format):
    """Read completely. Lines that start with # are comments; empty cells, NaN, NA and null are missing values."""

    name, suffixes = "csv", (".csv", ".csv.gz")
    description = "text table with a header, comma, semicolon or tab separated, plain or gzip"

    def open(self, path: Path) -> Table:
        content = _content(path)
        try:
            layout = _layout(path, content)
            frame = _parse(content, layout, pl.Float64)
        except BROKEN:
            return MemoryTable(*_texts(path, content, layout), str(path))
        except csv.Error as error:
            raise RecordingError(f"{path} is not a text table: {error} in its header; write it as plain CSV") from error
        return MemoryTable({column.name: column.to_numpy() for column in frame}, {}, str(path))

    def encode(self, columns: Mapping[str, Array], file: str) -> bytes:
        text = pl.DataFrame(dict(columns)).write_csv().encode()
        return gzip.compress(text, mtime=0) if file.lower().endswith(".gz") else text


def _content(path: Path) -> bytes:
    try:
        require_memory(path, TIMES * path.stat().st_size)
        content = path.read_bytes()
        if content[:2] == b"\x1f\x8b":
            content = gzip.GzipFile(fileobj=io.BytesIO(content)).read(int(min(MOST, free_memory() / TIMES)) + 1)
            require_memory(path, TIMES * len(content))
    except (EOFError, ZlibError, gzip.BadGzipFile) as error:
        raise RecordingError(f"{path} is cut short or damaged inside its gzip compression; copy it again") from error
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}") from error
    if len(content) > MOST:
        advice = "give long recordings as Parquet, which is read in chunks"
        raise RecordingError(f"{path} holds more than {MOST / 1e9:.3g} GB; {advice}")
    if len(content) > MOST_NEWLINES and 2 * content.count(b"\n") > len(content):
        raise RecordingError(f"{path} consists mostly of empty lines; write it again as plain CSV")
    if line := _long_line(content):
        fault = f"has more than {MOST_HEADER / 1e6:.0f} MB without an end of line after line {line}"
        raise RecordingError(f"{path} {fault}; write a line for each sample")
    if b"\0" in content[:65536]:
        raise RecordingError(f"{path} is not a text table: it holds binary data; correct the suffix of its name")
    return content


def _long_line(content: bytes) -> int:
    """Number of complete lines before one of more than MOST_HEADER bytes; 0 if there is none, or if it is the first."""
    place = 0
    while place + MOST_HEADER < len(content):
        end = content.rfind(b"\n", place, place + MOST_HEADER)
        if end < 0:
            return content.count(b"\n", 0, place)
        place = end + 1
    return 0


def _layout(path: Path, content: bytes) -> _Layout:
    """Parse the header: the first line that is neither blank nor a comment, or a comment directly above numbers."""
    comment, first, skip = "", "", 0
    lines = io.BytesIO(content)
    for skip, line in enumerate(lines, 1):
        if skip > MOST_BLANK or len(line) > MOST_HEADER:
            fault = f"a header of more than {MOST_HEADER / 1e6:.0f} MB, or {MOST_BLANK} lines without one"
            raise RecordingError(f"{path} has {fault}; expected a header such as t,q_1,tau_1 near its beginning")
        try:
            text = line.decode("utf-8-sig").strip("\r\n")
        except UnicodeDecodeError as error:
            raise RecordingError(f"{path} is not a text table: line {skip} is not UTF-8; save it as UTF-8") from error
        if text.strip(" \t,;") and not text.startswith("#"):
            first = text
            break
        comment = text.lstrip("# ") if text.startswith("#") else comment
    if not first:
        raise RecordingError(f"{path} is empty; expected a header such as t,q_1,tau_1 and a line for each sample")
    commented = bool(comment) and _is_numeric(_split(first))
    header = comment if commented else first
    names = [name.strip() for name in _split(header)]
    if len(names) > MOST_COLUMNS:
        fault = f"has {len(names)} columns, more than {MOST_COLUMNS}"
        raise RecordingError(f"{path} {fault}; write only those of the robot")
    if _is_numeric(names):
        raise RecordingError(f"{path} has no header: line {skip} holds numbers; put names such as t,q_1,tau_1 above it")
    if len(names) == 1 and len(names[0].split()) > 1:
        raise RecordingError(f"{path} separates its columns by blanks; expected commas, semicolons or tabs")
    if repeated := [name for name, count in Counter(names).items() if name and count > 1]:
        raise RecordingError(f"{path} names column {repeated[0]!r} twice in its header; give every column its own name")
    full = tuple(name or f"unnamed {i}" for i, name in enumerate(names, 1))
    separator = max(SEPARATORS, key=header.count)
    below = first if commented else next(lines, b"").decode("utf-8", "replace")
    return _Layout(full, separator, skip - commented, separator == ";" and "," in below)


def _split(line: str) -> list[str]:
    return next(csv.reader([line], delimiter=max(SEPARATORS, key=line.count)), [])


def _is_numeric(cells: Iterable[str]) -> bool:
    """Whether all non-empty cells are numbers, and there is at least one."""
    filled = [cell.strip() for cell in cells if cell.strip()]
    try:
        return bool([float(cell) for cell in filled])
    except ValueError:
        return False


def _parse(content: bytes, layout: _Layout, kind: type[pl.DataType]) -> pl.DataFrame:
    """Parse all columns with one data type: a type inferred from the first rows may not fit later ones."""
    with hushed():
        frame = pl.read_csv(
            content,
            has_header=False,
            schema={name: kind for name in layout.names},  # noqa: C420
            separator=layout.separator,
            skip_lines=layout.skip,
            comment_prefix="#",
            null_values=MISSING,
            **FILL,
            decimal_comma=layout.decimal_comma and kind == pl.Float64,
        )
    blank = pl.all_horizontal(pl.all().is_null())
    return frame.filter(~blank) if frame.height and frame.to_series(0).null_count() else frame


def _texts(path: Path, content: bytes, layout: _Layout) -> tuple[dict[str, Array], dict[str, str]]:
    """Numeric columns, and for each other column the reason with its first invalid cell."""
    try:
        frame = _parse(content, layout, pl.String)
    except BROKEN as error:
        raise RecordingError(_shape_fault(path, content, layout)) from error
    usable, unusable = {}, {}
    for text in frame:
        column = text.str.strip_chars()
        column = column.str.replace(",", ".", literal=True) if layout.decimal_comma else column
        number = column.cast(pl.Float64, strict=False)
        wrong = (number.is_null() & (column != "").fill_null(False) & ~column.is_in(MISSING)).arg_true()
        if len(wrong):
            unusable[text.name] = f"holds {text[wrong[0]]!r} in row {wrong[0] + 1}, expected a number or nothing"
        else:
            usable[text.name] = np.asarray(number.to_numpy(), np.float64)
    return usable, unusable


def _shape_fault(path: Path, content: bytes, layout: _Layout) -> str:
    """Error message with the first line that has more cells than the header."""
    lines = islice(io.StringIO(content.decode("utf-8", "replace")), layout.skip, None)
    samples = (line for line in lines if line.strip() and not line.startswith("#"))
    width = len(layout.names)
    with suppress(csv.Error):  # cell larger than the limit of csv
        for row, cells in enumerate(csv.reader(samples, delimiter=layout.separator), 1):
            if len(cells) > width:
                fault = f"has {len(cells)} cells in row {row}, but its header names {width} columns"
                return f"{path} {fault}; correct that line"
    return f"{path} is not a table of lines of {width} cells each; write it again as plain CSV"


PLUGIN = Csv()
