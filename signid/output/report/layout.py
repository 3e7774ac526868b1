"""Tables, headings and sentences that all commands print alike."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text


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
