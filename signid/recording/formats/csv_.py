"""Text tables separated by comma, semicolon, tab or blanks, plain or gzip-compressed."""

from __future__ import annotations

import csv
import gzip
import io
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Mapping
from contextlib import suppress
from inspect import signature
from itertools import islice
from pathlib import Path
from typing import Any
from zlib import error as ZlibError

import numpy as np
import polars as pl

from ...errors import RecordingError
from ...types import Array, Table
from ..names.mapping import Heading
from .base import MOST, About, Format, MemoryTable, free_memory, hushed, require_memory
from .text import BLANK, MISSING, TextLayout, find_layout, is_number

MOST_LINE = 1_000_000  # length of a line [bytes]
MOST_NEWLINES = 1_000_000  # size from which on a text of empty lines is refused [bytes]
ENDINGS = (".csv", ".txt", ".dat", ".tsv")
FOREIGN = 0.05  # largest share of bytes that are no ASCII in a text that is not UTF-8 [1]
MOST_FOOTER = 10  # lines of text below the samples
DAY = 86400.0  # [s]
DATES = (
    None,
    "%d.%m.%Y %H:%M:%S%.f",
    "%Y/%m/%d %H:%M:%S%.f",
    "%m/%d/%Y %H:%M:%S%.f",
    "%d/%m/%Y %H:%M:%S%.f",
)  # None: ISO
TIMES = 4  # peak memory while reading [times the size of the text]
BROKEN = (pl.exceptions.PolarsError, pl.exceptions.PanicException)
FILL: Any = {"missing_columns": "insert"} if "missing_columns" in signature(pl.read_csv).parameters else {}


class Csv(Format):
    """Read completely. Lines that start with # are comments; empty cells, NaN, NA and null are missing values."""

    name = "csv"
    suffixes = (*ENDINGS, *(f"{ending}.gz" for ending in ENDINGS))
    description = "text table, separated by commas, semicolons, tabs or blanks, plain or gzip"

    def open(self, path: Path) -> Table:
        return self.open_headed(path, Heading())

    def open_headed(self, path: Path, heading: Heading) -> Table:
        content = _content(path)
        try:
            layout = find_layout(path, content, heading)
            if layout.separator == BLANK:
                content = _single_blanks(content)
                _check_width(path, content, layout)
            about = About(layout.notes)
            frame = _parse(content, layout, pl.Float64)
        except BROKEN:
            return _of_texts(path, content, layout)
        except csv.Error as error:
            raise RecordingError(f"{path} is not a text table: {error} in its header; write it as plain CSV") from error
        return MemoryTable({column.name: column.to_numpy() for column in frame}, {}, str(path), about)

    def encode(self, columns: Mapping[str, Array], file: str) -> bytes:
        plain = file.lower().removesuffix(".gz")
        separator = "\t" if plain.endswith(".tsv") else "," if plain.endswith(".csv") else BLANK
        text = pl.DataFrame(dict(columns)).write_csv(separator=separator).encode()
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
        fault = f"has more than {MOST_LINE / 1e6:.0f} MB without an end of line after line {line}"
        raise RecordingError(f"{path} {fault}; write a line for each sample")
    content = _utf8(content)
    if b"\0" in content[:65536]:
        raise RecordingError(f"{path} is not a text table: it holds binary data; correct the suffix of its name")
    return content


def _utf8(content: bytes) -> bytes:
    """Text as UTF-8: from UTF-16 of spreadsheets, and from Windows-1252 where nearly all is ASCII; else as it is."""
    if content[:2] in (BOM_UTF16_LE, BOM_UTF16_BE):
        return content.decode("utf-16", "replace").encode()
    begun = content[:65536]
    if sum(byte > 127 for byte in begun) > FOREIGN * len(begun):
        return content
    try:
        content.decode()
    except UnicodeDecodeError:
        return content.decode("cp1252", "replace").encode()
    return content


def _long_line(content: bytes) -> int:
    """Number of complete lines before one of more than MOST_LINE bytes; 0 if there is none, or if it is the first."""
    place = 0
    while place + MOST_LINE < len(content):
        end = content.rfind(b"\n", place, place + MOST_LINE)
        if end < 0:
            return content.count(b"\n", 0, place)
        place = end + 1
    return 0


def _single_blanks(content: bytes) -> bytes:
    """Text with one blank in place of several blanks or tabs, and none at the ends of lines."""
    text = re.sub(rb"[ \t]{2,}|\t", b" ", content)
    return text.replace(b"\n ", b"\n").replace(b" \n", b"\n").replace(b" \r\n", b"\r\n").strip(b" ")


def _check_width(path: Path, content: bytes, layout: TextLayout) -> None:
    """Refuse a table separated by blanks in which a line is shorter: nobody knows which of its cells is missing."""
    width = len(layout.names)
    for number, line in enumerate(islice(io.BytesIO(content), layout.skip, None), layout.skip + 1):
        if line.strip() and not line.startswith(b"#") and len(line.split()) < width and b'"' not in line:
            fault = f"{path} has {len(line.split())} cells in line {number}, but {width} columns separated by blanks"
            raise RecordingError(f"{fault}; write nan for a missing value, or correct that line")


def _parse(content: bytes, layout: TextLayout, kind: type[pl.DataType]) -> pl.DataFrame:
    """Parse all columns with one data type: a type inferred from the first rows may not fit later ones."""
    with hushed():
        frame = pl.read_csv(
            content,
            has_header=False,
            schema={name: kind for name in layout.names},  # noqa: C420
            separator=layout.separator,
            skip_lines=layout.skip,
            comment_prefix="#",
            null_values=list(MISSING),
            **FILL,
            decimal_comma=layout.decimal_comma and kind == pl.Float64,
        )
    blank = pl.all_horizontal(pl.all().is_null())
    return frame.filter(~blank) if frame.height and frame.to_series(0).null_count() else frame


def _of_texts(path: Path, content: bytes, layout: TextLayout) -> MemoryTable:
    """Table of which some cells are no numbers: dates become seconds, other columns give the reason when they are read.

    Lines that repeat the header, and lines of text below the samples, are left out with a note.
    """
    try:
        frame = _parse(content, layout, pl.String)
    except BROKEN as error:
        raise RecordingError(_shape_fault(path, content, layout)) from error
    frame = frame.with_columns(pl.all().str.strip_chars())
    frame, notes = _samples(frame)
    usable, unusable = dict[str, Array](), dict[str, str]()
    for text in frame:
        column = text.str.replace(",", ".", literal=True) if layout.decimal_comma else text
        number = column.cast(pl.Float64, strict=False)
        wrong = (number.is_null() & (column != "").fill_null(False) & ~column.is_in(MISSING)).arg_true()
        if not len(wrong):
            usable[text.name] = np.asarray(number.to_numpy(), np.float64)
        elif (seconds := _seconds_of_dates(column)) is not None:
            usable[text.name] = seconds
            notes += (f"column {text.name!r} holds dates or times of day, read as seconds",)
        else:
            unusable[text.name] = f"holds {text[wrong[0]]!r} in row {wrong[0] + 1}, expected a number or nothing"
    return MemoryTable(usable, unusable, str(path), About((*layout.notes, *notes)))


def _samples(frame: pl.DataFrame) -> tuple[pl.DataFrame, tuple[str, ...]]:
    """Rows without those that repeat the header and those of text at the end, and notes."""
    repeated = (
        frame.select(pl.all_horizontal(pl.col(name) == name for name in frame.columns)).to_series().fill_null(False)
    )
    notes: tuple[str, ...] = (f"lines that repeat the header left out: {repeated.sum()}",) if repeated.any() else ()
    frame = frame.filter(~repeated)
    below = 0
    while below < min(MOST_FOOTER, frame.height - 1):
        first, *others = frame.row(frame.height - 1 - below)
        if not first or is_number(first) or not others or any(others):
            break
        below += 1
    if below:
        notes += (f"lines of text below the samples left out: {below}",)
    return frame.head(frame.height - below), notes


def _seconds_of_dates(column: pl.Series) -> Array | None:
    """Seconds since the first date, or of the day across midnights, (N,) with NaN where empty; None without dates."""
    known = column.filter((column != "").fill_null(False) & ~column.is_in(MISSING))
    plain = column.str.replace(r"(Z|[+-]\d\d:?\d\d)$", "")
    for form in DATES:
        with suppress(*BROKEN):
            dates = plain.str.to_datetime(form, time_unit="us", strict=False)
            if dates.count() == len(known) > 0:
                return np.asarray((dates - dates.drop_nulls()[0]).dt.total_microseconds().to_numpy(), np.float64) / 1e6
    with suppress(*BROKEN):
        times = plain.str.to_time("%H:%M:%S%.f", strict=False)
        if times.count() == len(known) > 0:
            seconds = np.asarray(times.cast(pl.Int64).to_numpy(), np.float64) / 1e9
            return np.unwrap(seconds, period=DAY) if np.isfinite(seconds).all() else seconds
    return None


def _shape_fault(path: Path, content: bytes, layout: TextLayout) -> str:
    """Error message with the first line that has more cells than the header."""
    lines = islice(io.StringIO(content.decode("utf-8", "replace")), layout.skip, None)
    samples = (line for line in lines if line.strip() and not line.startswith("#"))
    width = len(layout.names)
    if layout.separator == BLANK:
        samples = (re.sub(r"[ \t]+", BLANK, line.strip()) for line in samples)
    with suppress(csv.Error):  # cell larger than the limit of csv
        for row, cells in enumerate(csv.reader(samples, delimiter=layout.separator), 1):
            if len(cells) > width:
                fault = f"has {len(cells)} cells in row {row}, but its header names {width} columns"
                return f"{path} {fault}; correct that line"
    return f"{path} is not a table of lines of {width} cells each; write it again as plain CSV"


PLUGIN = Csv()
