"""Results as text of at most 40 lines and as compact HTML, from the tables of the commands."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from html import escape
from io import StringIO
from typing import Any

from rich.console import Console, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from .frames import frame_names
from .tables import tables

MOST, WIDTH = 40, 100  # lines, and characters per line, of a repr
LEAST = 3  # lines that a shortened section keeps: blank line, heading, number of the others
ASIDE = ("Alternatives", "Small corrections", "Residual of the simulation")  # headings of sections shortened first
ROWS, SENTENCES = 12, 12  # maximum number of rows per table, and of sentences, in HTML
CELL = "text-align:{};white-space:nowrap;padding:2px 10px 2px 0"


def text(result: Any) -> str:
    """Text of a result as the terminal shows it, without colours; long sections are shortened."""
    shown = tables(result)
    flags = [line for flag in _flags(result, shown) for line in _lines(Text(f"flag: {flag}"))]
    last = [line for names in _names(result) for line in _lines(Text(names))]
    return "\n".join([*_shortened([*_sections(shown), flags], MOST - len(last)), *last])


def html(result: Any) -> str:
    """HTML of a result for notebooks; names and sentences are escaped, long tables shortened."""
    blocks = tables(result)
    shown = [_element(each) for each in blocks]
    if len(shown) > (most := SENTENCES + 8):
        shown = [*shown[:most], _paragraph(f"and {len(shown) - most} more")]
    flags = [_paragraph(f"flag: {flag}", "color:#b3261e") for flag in _flags(result, blocks)]
    parts = [*flags[:SENTENCES], *shown, *(_paragraph(names, "color:#8a94a0") for names in _names(result))]
    return f'<div class="signid">{"".join(parts)}</div>'


def _flags(result: Any, shown: Sequence[RenderableType]) -> list[str]:
    """Flags that are no sentence of the tables."""
    said = {_plain(block) for block in shown}
    return [flag for flag in getattr(result, "flags", ()) if flag not in said]


def _names(result: Any) -> list[str]:
    """A line with the names of the tables, if there are any."""
    names = frame_names(result)
    return [f"tables, to_frame(name): {', '.join(names)}"] if names else []


def _sections(blocks: Iterable[RenderableType]) -> list[list[str]]:
    """Lines of blocks; a section begins at a blank line, which headings have above them."""
    found: list[list[str]] = [[]]
    for line in (line for block in blocks for line in _lines(block)):
        if not line and found[-1]:
            found.append([])
        found[-1] += [line] if line or len(found) > 1 else []
    return found


def _lines(block: RenderableType) -> list[str]:
    console = Console(
        file=StringIO(),
        width=WIDTH,
        color_system=None,
        markup=False,
        highlight=False,
        emoji=False,
        force_jupyter=False,  # in a notebook, rich would show each block as an output of its own
    )
    with console.capture() as shown:
        console.print(block)
    return [line.rstrip() for line in shown.get().splitlines()]


def _shortened(sections: Sequence[Sequence[str]], most: int) -> list[str]:
    """At most `most` lines: side matters are cut, then the longest sections, finally the last ones."""
    limits = [len(section) for section in sections]
    if sum(limits) > most:
        limits = [min(n, LEAST) if _is_aside(each) else n for n, each in zip(limits, sections, strict=True)]
    while sum(limits) > most and max(limits) > LEAST:
        limits[max(range(len(limits)), key=lambda k: (limits[k], k))] -= 1
    lines = [line for section, limit in zip(sections, limits, strict=True) for line in _cut(section, limit)]
    return lines if len(lines) <= most else [*lines[: most - 1], f"... and {len(lines) - most + 1} more lines"]


def _is_aside(section: Sequence[str]) -> bool:
    """Whether a section begins with the heading of a side matter, below a blank line."""
    return len(section) > 1 and section[1].startswith(ASIDE)


def _cut(block: Sequence[str], limit: int) -> list[str]:
    return list(block) if len(block) <= limit else [*block[: limit - 1], f"... and {len(block) - limit + 1} more lines"]


def _element(block: RenderableType) -> str:
    if isinstance(block, Padding):
        return f'<div style="margin-left:16px">{_element(block.renderable)}</div>'
    if isinstance(block, Table):
        return _table(block)
    shown = _plain(block)
    bold = isinstance(block, Text) and ("bold" in str(block.style) or any("bold" in str(s.style) for s in block.spans))
    return _paragraph(shown, "font-weight:600" if bold else "")


def _paragraph(sentence: str, style: str = "") -> str:
    return f'<p style="margin:4px 0;{style}">{escape(sentence.strip())}</p>'


def _table(table: Table) -> str:
    heads = "".join(_cell("th", _plain(column.header), column.justify) for column in table.columns)
    rows = list(zip(*(column.cells for column in table.columns), strict=True))
    aligned = [column.justify for column in table.columns]
    body = "".join(f"<tr>{''.join(_cells(row, aligned))}</tr>" for row in rows[:ROWS])
    more = [_paragraph(f"and {len(rows) - ROWS} more rows")] if len(rows) > ROWS else []
    return "".join([f"<table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>", *more])


def _cells(row: Iterable[RenderableType], aligned: Sequence[str]) -> Iterator[str]:
    return (_cell("td", _plain(cell), align) for cell, align in zip(row, aligned, strict=True))


def _cell(kind: str, shown: str, align: str) -> str:
    return f'<{kind} style="{CELL.format(align)}">{escape(shown)}</{kind}>'


def _plain(block: RenderableType) -> str:
    return block.plain if isinstance(block, Text) else str(block)
