"""Layout shared by all commands: tables, headings and sentences."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable

from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

PIPED = 100  # width of the output if it is not a terminal [characters]


class Screen(Console):
    """Current standard output, without markup, and without colours if it is not a terminal."""

    def __init__(self) -> None:
        if hasattr(sys.stdout, "reconfigure"):
            sys.stdout.reconfigure(errors="replace")  # the encoding may lack "±"
        known = sys.stdout.isatty() or "COLUMNS" in os.environ
        super().__init__(markup=False, highlight=False, emoji=False, width=None if known else PIPED)

    def write(self, text: str) -> None:
        """Write text unchanged, neither wrapped nor coloured."""
        try:
            sys.stdout.write(text)
            sys.stdout.flush()
        except BrokenPipeError:
            self.on_broken_pipe()

    def on_broken_pipe(self) -> None:
        """Stop writing without an error when the reader closes the pipe."""
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def new_table(*heads: str, rows: Iterable[Iterable[RenderableType]] = ()) -> Table:
    """Create a table from its heads and rows; columns whose head ends in > are right-aligned and do not wrap."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="dim")
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
    return Text(text)


def note_lines(notes: Iterable[str]) -> list[RenderableType]:
    """One line per note, without repetitions."""
    return [paragraph(f"note: {note}") for note in dict.fromkeys(notes)]


def plural(number: int, noun: str) -> str:
    """Format a count with its noun."""
    return f"{number} {noun}{'' if number == 1 else 's'}"
