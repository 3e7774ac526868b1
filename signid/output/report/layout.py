"""Tables, headings and sentences that all commands print alike."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable

from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

PIPED = 100  # columns where there is no terminal to ask


class Screen(Console):
    """Standard output as it is when called: no colour codes where it is no terminal, brackets stay brackets."""

    def __init__(self) -> None:
        if hasattr(sys.stdout, "reconfigure"):
            sys.stdout.reconfigure(errors="replace")  # where "±" cannot be written
        known = sys.stdout.isatty() or "COLUMNS" in os.environ
        super().__init__(markup=False, highlight=False, emoji=False, width=None if known else PIPED)

    def write(self, text: str) -> None:
        """Text as it stands: neither wrapped nor coloured."""
        try:
            sys.stdout.write(text)
            sys.stdout.flush()
        except BrokenPipeError:
            self.on_broken_pipe()

    def on_broken_pipe(self) -> None:
        """Go on in silence: a reader that has seen enough is no error."""
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def new_table(*heads: str) -> Table:
    """Columns by their heads, to the right where a head ends in >; formulas may wrap, numbers may not."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="dim")
    for head in heads:
        right = head.endswith(">")
        table.add_column(head.removesuffix(">"), justify="right" if right else "left", no_wrap=right, overflow="fold")
    return table


def heading(text: str, below: bool = True) -> RenderableType:
    """Bold, a blank line above."""
    return Text.assemble("\n" if below else "", (text, "bold"))


def paragraph(text: str) -> RenderableType:
    """Text as it stands."""
    return Text(text)


def note_lines(notes: Iterable[str]) -> list[RenderableType]:
    """Each note once."""
    return [paragraph(f"note: {note}") for note in dict.fromkeys(notes)]


def plural(number: int, what: str) -> str:
    """A number and what it counts."""
    return f"{number} {what}{'' if number == 1 else 's'}"
