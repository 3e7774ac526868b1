"""Text tables separated by comma, semicolon, tab or blanks, plain or gzip-compressed."""

from __future__ import annotations

import csv
import gzip
import io
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from inspect import signature
from io import BytesIO
from itertools import count, islice
from pathlib import Path
from typing import Any, NamedTuple
from zlib import error as ZlibError

import numpy as np
import polars as pl

from ...errors import RecordingError, shorten
from ...types import Array, Table
from ..mapping import Heading, split
from ..vocabulary import bracketed, unit_row
from .base import MAX_UNPACKED, MOST_COLUMNS, About, Format, MemoryTable, free_memory, hushed, require_memory

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
SEPARATORS, BLANK = ",;\t", " "
MOST_HEADER, MOST_BLANK = 1_000_000, 10_000  # bytes, lines before a header
SEEN = 64  # lines, without blank ones and comments, in which the header is searched
BELOW = 3  # lines below a header that must be regular, if there are as many
MARKS = ("#", "%", "//")  # beginnings of comments before the samples
MISSING = tuple("NA N/A n/a n.a. #N/A NAN null NULL None none - -- -nan -NaN nan(ind) -nan(ind)".split())
NAME = re.compile(r"(.*?)names?[_.\[]?(\d+)\]?", re.IGNORECASE)  # columns of texts that name the columns of one number


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
                content = re.sub(rb"[ \t]{2,}|\t", b" ", content)  # one blank for several, and none at ends of lines
                content = content.replace(b"\n ", b"\n").replace(b" \n", b"\n").replace(b" \r\n", b"\r\n").strip(b" ")
                rows = islice(io.BytesIO(content), layout.skip, None)
                for number, line in enumerate(rows, layout.skip + 1):
                    cells, width = len(line.split()), len(layout.names)
                    # nobody knows which cell of a short line is missing
                    if line.strip() and not line.startswith(b"#") and cells < width and b'"' not in line:
                        fault = f"has {cells} cells in line {number}, but {width} columns separated by blanks"
                        raise RecordingError(f"{path} {fault}; write nan for a missing value, or correct that line")
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
            content = gzip.GzipFile(fileobj=io.BytesIO(content)).read(int(min(MAX_UNPACKED, free_memory() / TIMES)) + 1)
            require_memory(path, TIMES * len(content))
    except (EOFError, ZlibError, gzip.BadGzipFile) as error:
        raise RecordingError(f"{path} is cut short or damaged inside its gzip compression; copy it again") from error
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}") from error
    if len(content) > MAX_UNPACKED:
        advice = "give long recordings as Parquet, which is read in chunks"
        raise RecordingError(f"{path} holds more than {MAX_UNPACKED / 1e9:.3g} GB; {advice}")
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
    frame = frame.head(frame.height - below)
    numbered = [(text, match[2]) for text in frame if (match := NAME.fullmatch(text.name)) and text.n_unique() == 1]
    names = {number: str(text[0]) for text, number in numbered if text[0] and not is_number(text[0])}
    ends = {column: re.fullmatch(r"(.*?[_.\[])(\d+)\]?", column) for column in frame.columns}
    texts = {text.name for text, _ in numbered}
    known = {column: end for column, end in ends.items() if end and end[2] in names and column not in texts}
    new = {column: f"{end[1].rstrip('[._')}_{names[end[2]]}" for column, end in known.items()}
    if new and len({*new.values()} - {*frame.columns}) == len(new):
        frame = frame.rename(new).drop(texts)
        notes += (f"columns are named by the texts of {shorten(sorted(texts), 3)}",)
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


@dataclass(frozen=True)
class TextLayout:
    """Header of a table."""

    names: tuple[str, ...]
    separator: str  # one of SEPARATORS, or a blank for any number of blanks and tabs
    skip: int  # lines before the first sample
    decimal_comma: bool
    notes: tuple[str, ...] = ()


class TextLine(NamedTuple):
    """A line that is not blank."""

    number: int  # from 1
    text: str  # without the mark of a comment
    comment: bool


def find_layout(path: Path, content: bytes, heading: Heading) -> TextLayout:
    """Find the header: above regular lines, also below other lines or in a comment; stated names take its place.

    A comment directly above numbers may be the header. A row of units below it is added to the names: "q_1 [rad]".

    Raises:
        RecordingError: no header, columns without different names, or no text.
    """
    lines = list(_beginning(path, content, heading.skip))
    rows = [line for line in lines if not line.comment]
    if not rows:
        raise RecordingError(f"{path} is empty; expected a header such as t,q_1,tau_1 and a line for each sample")
    if heading.names:
        return _stated(path, rows, heading)
    header, separator = _header(path, lines, rows)
    names = split_cells(header.text, separator_of(header.text))
    if len(names) > MOST_COLUMNS:
        fault = f"has {len(names)} columns, more than {MOST_COLUMNS}"
        raise RecordingError(f"{path} {fault}; write only those of the robot")
    if repeated := [name for name, count in Counter(names).items() if name and count > 1]:
        numbers = {name: count(1) for name in repeated}
        names = [f"{name}_{next(numbers[name])}" if name in numbers else name for name in names]
        if any(split(name) or name == "t" for name in repeated) or len(set(names)) < len(names):
            fault = f"{path} names column {repeated[0]!r} twice in its header"
            raise RecordingError(f"{fault}; give every column its own name")
    below = [row for row in rows if row.number > header.number]
    before = sum(row.number < header.number for row in rows)
    what = "1 line" if before == 1 else f"{before} lines"
    notes = [f"{what} before the header, which is line {header.number}, left out"] if before else []
    notes += [f"columns of the same name are numbered: {shorten(repeated)}"] if repeated else []
    skip = header.number
    if below and len(names) > 1 and len(cells := split_cells(below[0].text, separator)) == len(names):
        if units := unit_row(cells):
            names = [
                f"{n} [{unit}]" if unit and not bracketed(n)[1] else n for n, unit in zip(names, units, strict=True)
            ]
            skip, below = below[0].number, below[1:]
    full = tuple(name or f"unnamed {i}" for i, name in enumerate(names, 1))
    decimal_comma = separator != "," and bool(below) and "," in below[0].text
    return TextLayout(full, separator, skip, decimal_comma, tuple(notes))


def split_cells(line: str, separator: str) -> list[str]:
    """Cells of a line, without blanks around them."""
    text = re.sub(r"[ \t]+", BLANK, line.strip()) if separator == BLANK else line
    try:
        return [cell.strip() for cell in next(csv.reader([text], delimiter=separator), [])]
    except csv.Error:  # a cell that is too long
        return []


def is_number(cell: str, decimal_comma: bool = False) -> bool:
    """Whether a cell is a number."""
    try:
        float(cell.replace(",", ".") if decimal_comma else cell)
    except ValueError:
        return False
    return True


def separator_of(header: str) -> str:
    """Separator of a header: the most frequent of comma, semicolon and tab; without one, blanks between two words."""
    best = max(SEPARATORS, key=header.count)
    return best if best in header or len(header.split()) < 2 else BLANK


def _beginning(path: Path, content: bytes, skip: int) -> Iterable[TextLine]:
    """First lines that are not blank, below the skipped ones."""
    rows = 0
    for number, line in enumerate(islice(BytesIO(content), skip, None), skip + 1):
        if rows == 0 and (number - skip > MOST_BLANK or len(line) > MOST_HEADER):
            fault = f"a header of more than {MOST_HEADER / 1e6:.0f} MB, or {MOST_BLANK} lines without one"
            raise RecordingError(f"{path} has {fault}; expected a header such as t,q_1,tau_1 near its beginning")
        try:
            text = line.decode("utf-8-sig").strip("\r\n")
        except UnicodeDecodeError as error:
            fault = f"{path} is not a text table: line {number} is not UTF-8; save it as UTF-8"
            raise RecordingError(fault) from error
        if not text.strip(" \t,;"):
            continue
        comment = text.lstrip().startswith(MARKS)
        yield TextLine(number, text.lstrip().lstrip("#%/ ") if comment else text, comment)
        rows += not comment
        if rows == SEEN:
            return


def _header(path: Path, lines: Sequence[TextLine], rows: Sequence[TextLine]) -> tuple[TextLine, str]:
    """Line of the header, and the separator of the samples.

    Raises:
        RecordingError: there is no header.
    """
    above = [line for line in lines if line.comment and line.number < rows[0].number]
    numbers = _all_numbers(rows[0].text)
    for line in reversed(above):
        if separator := _regular(line.text, rows, strict=True):
            return line, separator
    if numbers and above and len(split_cells(above[-1].text, separator_of(above[-1].text))) > 1:
        return above[-1], separator_of(above[-1].text)
    if not numbers:
        for k, row in enumerate(rows):
            if separator := _regular(row.text, rows[k + 1 :], strict=k > 0):
                return row, separator
    first = next((row for row in rows if _all_numbers(row.text)), rows[-1])
    separator = separator_of(rows[0].text)
    cells = split_cells(rows[0].text, separator)
    prose = len(cells) == 1 or (separator == BLANK and "t" not in cells)  # no cells of a table
    count = len(_number_cells(first.text))
    if numbers or (prose and first is not rows[0] and 1 < count != len(cells)):
        fault = f"{path} has no header: line {first.number} holds numbers"
        advice = "put names such as t,q_1,tau_1 above it, or state them: signid convert --names t,q_1,tau_1"
        raise RecordingError(f"{fault}; {advice}")
    return rows[0], separator


def _regular(header: str, below: Sequence[TextLine], strict: bool) -> str:
    """Separator with which the lines below a header have as many cells as it has, and numbers; "" if they have not.

    `strict`: every name is one, half of the cells are numbers or missing; for headers that are not at the beginning.
    """
    header_separator = separator_of(header)
    candidates: list[str] = [header_separator, *SEPARATORS, BLANK]
    for separator in candidates:
        names = split_cells(header, header_separator)
        rows = [split_cells(line.text, separator) for line in below[: BELOW + 1]]
        if rows and unit_row(rows[0]):
            del rows[0]
        if len(names) < 2 or not rows or any(len(row) != len(names) for row in rows[:BELOW]):
            continue
        if strict and not (all(names) and len({*names}) == len(names) and not any(map(is_number, names))):
            continue
        if all(_numeric(row, separator, strict) for row in rows[:BELOW]):
            return separator
    return ""


def _numeric(cells: Sequence[str], separator: str, strict: bool) -> bool:
    """Whether a cell is a number; `strict`: half of them, or missing."""
    count = sum(is_number(cell, separator != ",") for cell in cells)
    known = count + sum(cell in ("", *MISSING) for cell in cells)
    return count > 0 and (not strict or 2 * known >= len(cells))


def _number_cells(line: str) -> list[str]:
    """Cells of a line of numbers; empty if it holds anything else."""
    numbers: list[str] = []
    for separator in (";", "\t", ",", BLANK):
        cells = split_cells(line, separator)
        filled = [cell for cell in cells if cell]
        if filled and len(cells) > len(numbers) and all(is_number(cell, separator != ",") for cell in filled):
            numbers = cells
    return numbers


def _all_numbers(line: str) -> bool:
    return bool(_number_cells(line))


def _stated(path: Path, rows: Sequence[TextLine], heading: Heading) -> TextLayout:
    """Layout of a table whose names are stated; lines above its first line of numbers are left out.

    Raises:
        RecordingError: another number of names than of columns.
    """
    names = heading.names
    for row in rows:
        for separator in (*SEPARATORS, BLANK):
            cells = split_cells(row.text, separator)
            if len(cells) == len(names) and _numeric(cells, separator, strict=True):
                full = tuple(name or f"unnamed {i}" for i, name in enumerate(names, 1))
                return TextLayout(full, separator, row.number - 1, separator != "," and "," in row.text)
    first = next((row for row in rows if _all_numbers(row.text)), rows[-1])
    cells = _number_cells(first.text) or split_cells(first.text, separator_of(first.text))
    fault = f"{path} has {len(cells)} columns in line {first.number}, but {len(names)} names are stated"
    raise RecordingError(f'{fault}; state a name for each column, "" for one that is not used')
