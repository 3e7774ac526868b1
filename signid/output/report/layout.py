"""Layout shared by all commands and pages: numbers with their significant digits, tables, headings and sentences."""

from __future__ import annotations

import hashlib
import os
import re
import sys
from base64 import b64encode
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from html import escape
from math import copysign, floor, isfinite, log10
from string import Template
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.measure import Measurement
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from ...errors import CONTROL, named_for_caller
from ...types import TWO_SIDED, Robot

MAX_DIGITS = 9  # maximum number of significant digits
UNKNOWN_TEXT = "not identifiable"  # text in place of a value without finite interval
MAX_NUMBER = 1.79e308  # values beyond would round up to infinity
MAX_UNCUT_NAME = 16  # length of a name that is never cut [characters]
CERTAINTY = 0.999  # probability that is shown as larger, and confidence from which a sign is considered certain
PIPED_WIDTH = 100  # width of the output if it is not a terminal [characters]
NO_CONNECTION = "connect-src 'none'"  # replaced in the page that a live replay serves


class Screen(Console):
    """Current standard output, without markup, and without colours if it is not a terminal."""

    def __init__(self) -> None:
        if hasattr(sys.stdout, "reconfigure"):
            sys.stdout.reconfigure(errors="replace")  # the encoding may lack "±"
        known = sys.stdout.isatty() or "COLUMNS" in os.environ
        super().__init__(markup=False, highlight=False, emoji=False, width=None if known else PIPED_WIDTH)

    def write(self, text: str) -> None:
        """Write text unchanged, neither wrapped nor coloured."""
        try:
            sys.stdout.write(text)
            sys.stdout.flush()
        except BrokenPipeError:
            self.on_broken_pipe()

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterator[Segment]:
        """Segments of text without control characters, which names of columns and files may hold, but line ends."""
        for segment in super().render(renderable, options):
            lines = segment.text.split("\n")
            safe = "\n".join(CONTROL.sub("\N{REPLACEMENT CHARACTER}", line) for line in lines)
            yield segment if segment.control else segment._replace(text=safe)

    def on_broken_pipe(self) -> None:
        """Stop writing without an error when the reader closes the pipe."""
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _width(console: Console, column: Column) -> int:
    """Width that a column needs with its padding: that of its numbers, or of a short name if it can wrap."""
    wide = max(Measurement.get(console, console.options, x).maximum for x in (column.header, *column.cells))
    return 2 + (wide if column.no_wrap else min(wide, MAX_UNCUT_NAME))


class Worse(str):
    """Text of a cell with an error that is clearly larger than before: red."""

    worse = True


class _Name:
    """A long word, such as the name of a joint, that loses its middle in a narrow column instead of being folded."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        return Measurement(min(MAX_UNCUT_NAME, options.max_width), min(len(self.name), options.max_width))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Text]:
        spare = max(options.max_width - 1, 2)
        cut = f"{self.name[: (spare + 1) // 2]}…{self.name[-(spare // 2) :]}"
        yield Text(self.name if len(self.name) <= options.max_width else cut)


class _Table(Table):
    """A table that is continued below, with its first column again, if the numbers of all columns do not fit."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        first, groups, room = self.columns[:1], [list[Column]()], 0
        for column in self.columns[1:]:
            taken = _width(console, column)
            if taken > room:
                groups.append([])
                room = options.max_width - sum(_width(console, head) for head in first)
            groups[-1].append(column)
            room -= taken
        groups = [group for group in groups if group]
        if len(groups) < 2:
            yield from super().__rich_console__(console, options)
            return
        for k, group in enumerate(groups):
            part = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="dim")
            part.columns = [replace(column, _index=i) for i, column in enumerate([*first, *group])]
            part.rows = self.rows
            if k:
                yield Text()
            yield part

    def add_row(self, *cells: RenderableType | None, **settings: Any) -> None:
        first = [name_cell(x) if isinstance(x, str) else x for x in cells[:1]]
        others = [Text(x, "red") if isinstance(x, Worse) else x for x in cells[1:]]
        super().add_row(*first, *others, **settings)


def name_cell(name: str) -> RenderableType:
    """Cell with a name; a long name without blanks loses its middle in a narrow column."""
    return _Name(name) if len(name) > MAX_UNCUT_NAME and name.isidentifier() else name


def new_table(*heads: str, rows: Iterable[Iterable[RenderableType]] = ()) -> Table:
    """Create a table from its heads and rows; columns whose head ends in > are right-aligned and do not wrap.

    In a narrow terminal, long names in the first column lose their middle.
    """
    table = _Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="dim")
    for head in heads:
        right = head.endswith(">")
        table.add_column(head.removesuffix(">"), justify="right" if right else "left", no_wrap=right, overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


def heading(text: str, below: bool = True) -> RenderableType:
    """Bold line, with a blank line above if `below` other text."""
    return Text.assemble("\n" if below else "", (text, "bold"))


def paragraph(text: str) -> RenderableType:
    """Plain text."""
    return Text(named_for_caller(text))


def note_lines(notes: Iterable[str]) -> list[RenderableType]:
    """One line per note, without repetitions."""
    return [paragraph(f"note: {note}") for note in dict.fromkeys(notes)]


def plural(number: int, noun: str) -> str:
    """Format a count with its noun."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def figure(value: float, digits: int = 3) -> str:
    """Format a number with significant digits, trailing zeros kept; "-" if not finite.

    >>> figure(0.04), figure(24.96), figure(1234.5), figure(2.5e-7), figure(float("nan"))
    ('0.0400', '25.0', '1234', '2.50e-07', '-')
    """
    if not isfinite(value):
        return "-"
    if value == 0:
        return "0"
    if abs(value) > MAX_NUMBER:
        return figure(copysign(MAX_NUMBER, value), digits)
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    power = int(exponent)
    if not -4 <= power < 6:
        return f"{mantissa}e{exponent}"
    return f"{value:.{max(0, digits - 1 - power)}f}"


def thousandths(value: float, digits: int = 3) -> str:
    """Format a position error in thousandths of its unit.

    >>> thousandths(0.00172), thousandths(float("inf")), thousandths(float("nan"))
    ('1.72', 'diverges', '-')
    """
    return "diverges" if value == float("inf") else figure(1e3 * value, digits)


def with_interval(value: float, std: float) -> tuple[str, str]:
    """Format a value and the half-width of its 95 % interval, to two significant digits of the half-width.

    >>> with_interval(3.86269, 0.0123), with_interval(1234.5, 66.0), with_interval(2.3456e-6, 1e-8)
    (('3.863', '0.024'), ('1230', '130'), ('2.346e-06', '0.020e-06'))
    >>> with_interval(0.7, float("inf")), with_interval(0.7, 0.0)
    (('not identifiable', '-'), ('0.700000', '0'))
    """
    if not (isfinite(value) and isfinite(std)):
        return UNKNOWN_TEXT, "-"
    half = TWO_SIDED * std
    largest = _power(max(abs(value), half))
    if half <= 0:
        return figure(value, 6), "0"
    last = max(_power(half) - 1, largest - MAX_DIGITS + 1)  # power of ten of the last digit shown
    if floor(half / 10.0**last + 0.5) >= 100:
        last += 1
    if largest < -5 or largest >= 7:
        places, unit = max(0, largest - last), 10.0**largest
        return tuple(f"{x / unit:z.{places}f}e{largest:+03d}" for x in (value, half))  # type: ignore[return-value]
    if last > 0:
        value, half = (round(x / 10.0**last) * 10.0**last for x in (value, half))
    places = max(0, -last)
    return f"{value:z.{places}f}", f"{half:.{places}f}"


def share(value: float) -> str:
    """Format a share in per cent, never rounded up to 100 % or down to 0 %.

    >>> share(1.0), share(0.9996), share(0.5), share(0.0001), share(0.0)
    ('100 %', '>99 %', '50 %', '<1 %', '0 %')
    """
    if not isfinite(value):
        return "-"
    if 0.995 <= value < 1:
        return ">99 %"
    if 0 < value < 0.005:
        return "<1 %"
    return f"{value:.0%}".replace("%", " %")


def confidence(value: float) -> str:
    """Format a probability, never rounded up.

    >>> confidence(0.99949), confidence(0.99899), confidence(1.0), confidence(float("nan"))
    ('>0.999', '0.998', '>0.999', '-')
    """
    if not isfinite(value):
        return "-"
    return f">{CERTAINTY}" if value >= CERTAINTY else f"{floor(1000 * value) / 1000:.3f}"


def log_odds(odds: float) -> str:
    """Log odds with at most three digits, beyond which they say no more.

    >>> log_odds(5.04), log_odds(512.3), log_odds(425721.0)
    ('5.0', '512', '> 999')
    """
    return "> 999" if odds >= 999.5 else f"{odds:.1f}" if abs(odds) < 99.95 else f"{odds:.0f}"


def determination(r2: float) -> str:
    """Format R2 with two significant digits of 1 - R2.

    >>> determination(0.99871), determination(0.957), determination(0.9999999), determination(float("nan"))
    ('0.9987', '0.957', '1.000000', '-')
    """
    if not isfinite(r2):
        return "-"
    return f"{r2:.{min(6, max(2, 1 - _power(abs(1 - r2))))}f}"


def _power(value: float) -> int:
    return floor(log10(value)) if value > 0 else -300


def torque_units(robot: Robot) -> list[str]:
    """Unit of the torque of each joint."""
    return ["N" if prismatic else "N.m" for prismatic in robot.prismatic]


def position_units(robot: Robot) -> list[str]:
    """Unit of the position of each joint."""
    return ["m" if prismatic else "rad" for prismatic in robot.prismatic]


class PlotMarkup(str):
    """Text for Plotly with tags and `%{...}` of signid's own; the names in it are escaped."""


def plot_markup(template: str, **names: str) -> PlotMarkup:
    """Fill escaped names into a text with tags and `%{...}` for Plotly.

    >>> plot_markup("$joint at %{x} s<extra></extra>", joint="<b>%{y}")
    '&lt;b&gt;&#37;{y} at %{x} s<extra></extra>'
    """
    return PlotMarkup(Template(template).substitute({key: plot_text(name) for key, name in names.items()}))


def plot_text(text: str) -> str:
    """Escape a text for Plotly, which renders tags in any text and fills `%{...}` in hover texts."""
    return escape(text, quote=False).replace("%{", "&#37;{")


def escaped(part: Any) -> Any:
    """Escape each string of a figure for Plotly, except PlotMarkup."""
    if isinstance(part, PlotMarkup):
        return str(part)
    if isinstance(part, str):
        return plot_text(part)
    if isinstance(part, Mapping):
        return {key: escaped(inner) for key, inner in part.items()}
    if isinstance(part, list | tuple):
        return [escaped(inner) for inner in part]
    return part


def content_policy(scripts: Iterable[str]) -> str:
    """Content-Security-Policy of a page: only these inline scripts run, and nothing is requested from outside."""
    read = (re.sub("\r\n?", "\n", script).encode() for script in scripts)  # by a browser, with line feeds alone
    hashes = " ".join(f"'sha256-{b64encode(hashlib.sha256(script).digest()).decode()}'" for script in read)
    return (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; {NO_CONNECTION}; "
        "object-src 'none'; base-uri 'none'; form-action 'none'"
    )
