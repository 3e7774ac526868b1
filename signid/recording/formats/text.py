"""Layout of a text table: where its header is, what separates its cells, and the units below its names."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from ...errors import RecordingError
from ..names.mapping import Heading
from ..names.vocabulary import bracketed, unit_row
from .base import MOST_COLUMNS

SEPARATORS, BLANK = ",;\t", " "
MOST_HEADER, MOST_BLANK = 1_000_000, 10_000  # bytes, lines before a header
SEEN = 64  # lines, without blank ones and comments, in which the header is searched
BELOW = 3  # lines below a header that must be regular, if there are as many
MARKS = ("#", "%", "//")  # beginnings of comments before the samples
MISSING = ("NA", "N/A", "null", "NULL", "None", "none", "-nan", "-NaN", "nan(ind)", "-nan(ind)")


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
        raise RecordingError(f"{path} names column {repeated[0]!r} twice in its header; give every column its own name")
    below = [row for row in rows if row.number > header.number]
    skip, notes = header.number, _skipped(rows, header)
    if below and len(names) > 1 and len(cells := split_cells(below[0].text, separator)) == len(names):
        if units := unit_row(cells):
            names = [
                f"{n} [{unit}]" if unit and not bracketed(n)[1] else n for n, unit in zip(names, units, strict=True)
            ]
            skip, below = below[0].number, below[1:]
    full = tuple(name or f"unnamed {i}" for i, name in enumerate(names, 1))
    decimal_comma = separator != "," and bool(below) and "," in below[0].text
    return TextLayout(full, separator, skip, decimal_comma, notes)


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
    own = separator_of(header)
    candidates: list[str] = [own, *SEPARATORS, BLANK]
    for separator in candidates:
        names = split_cells(header, own)
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
    found: list[str] = []
    for separator in (";", "\t", ",", BLANK):
        cells = split_cells(line, separator)
        filled = [cell for cell in cells if cell]
        if filled and len(cells) > len(found) and all(is_number(cell, separator != ",") for cell in filled):
            found = cells
    return found


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


def _skipped(rows: Sequence[TextLine], header: TextLine) -> tuple[str, ...]:
    before = sum(row.number < header.number for row in rows)
    what = "1 line" if before == 1 else f"{before} lines"
    return (f"{what} before the header, which is line {header.number}, left out",) if before else ()
