"""Sections of the description of a result, which the terminal and its page share."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple, TypeAlias, Union

from rich.console import RenderableType

from .layout import escaped, heading, new_table, note_lines, paragraph

INK = "#1f2933"
TRANSPARENT = "rgba(0,0,0,0)"
PLAIN_LAYOUT = {"paper_bgcolor": TRANSPARENT, "plot_bgcolor": TRANSPARENT, "margin": {"l": 8, "r": 10, "t": 10, "b": 8}}
PLOT_FONT = {"family": "system-ui, Segoe UI, Helvetica, Arial, sans-serif", "size": 12, "color": INK}
Block: TypeAlias = Union["Cells", "Sentences", "Plain", "Legend", "Key", "Folds", "Fold", "Laws", "Plots"]


class Card(NamedTuple):
    """A key figure."""

    title: str
    figure: str
    beside: str


class Plot(NamedTuple):
    """A plot: traces and layout for Plotly."""

    name: str  # caption and text alternative
    data: list[dict[str, Any]]
    layout: dict[str, Any]
    height: int = 240  # [pixels]
    wide: bool = False  # full width of the page

    @property
    def content(self) -> dict[str, Any]:
        """Data and layout for Plotly; names in them are escaped."""
        layout = {"font": PLOT_FONT, "showlegend": False, "hovermode": "closest", **PLAIN_LAYOUT, **self.layout}
        return {"data": escaped(self.data), "layout": escaped({**layout, "height": self.height})}

    @property
    def text(self) -> str:
        """JSON text, safe inside a page."""
        return json.dumps(self.content, separators=(",", ":"), ensure_ascii=True).replace("<", "\\u003c")


class JointPlots(NamedTuple):
    """Plots of a joint."""

    name: str
    summary: str
    open: bool
    plots: tuple[Plot, ...]


class Bar(str):
    """Text of a cell that a page draws as a bar, of a length [%]."""

    percent: float

    def __new__(cls, text: str, percent: float) -> Bar:
        bar = super().__new__(cls, text)
        bar.percent = percent
        return bar


class Cells(NamedTuple):
    """A table: heads, `>` at the end for columns of numbers, and rows of texts."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]


class Sentences(NamedTuple):
    """Sentences, one a line; a list on a page."""

    said: Sequence[str]


class Plain(NamedTuple):
    """A sentence; a paragraph on a page."""

    plain: str


class Legend(NamedTuple):
    """Small print of a page."""

    legend: str


class Key(NamedTuple):
    """Colours of the lines of a page: class of the style or colour of each, and its name."""

    marks: Sequence[tuple[str, str]]


class Folds(NamedTuple):
    """Plots of a page that unfold joint by joint, with a note."""

    note: str
    joints: Sequence[JointPlots]


class Fold(NamedTuple):
    """Sentences of a page that unfold below a summary."""

    summary: str
    folded: Sequence[str]


class LawCard(NamedTuple):
    """A law that was found, with its numbers and alternatives; its text is empty where another card has it."""

    title: str
    probability: str
    sure: bool
    summary: str
    equation: str
    numbers: Cells
    evidence: str
    source: str
    rivals: Sequence[tuple[str, Bar]]  # the law and its alternatives with their probabilities; none without any


class Laws(NamedTuple):
    """Laws of a page that were found."""

    laws: Sequence[LawCard]


class Plots(NamedTuple):
    """Plots of a page side by side."""

    plots: Sequence[Plot]


class Section(NamedTuple):
    """Part of a description; one without content is not shown."""

    title: str
    blocks: tuple[Block, ...]
    level: int = 2  # of its heading on a page

    @property
    def shown(self) -> tuple[Block, ...]:
        """Blocks with content."""
        return tuple(block for block in self.blocks if block[-1])

    def beside(self, *blocks: Block) -> Section:
        """The section with further blocks, for its page."""
        return self._replace(blocks=(*self.blocks, *blocks))


def terminal(sections: Iterable[Section], notes: Iterable[str]) -> list[RenderableType]:
    """Headings, tables and sentences of the sections that have any, and notes."""
    shown: list[RenderableType] = []
    for section in sections:
        if section.title and section.shown:
            shown.append(heading(section.title))
        for block in section.shown:
            if isinstance(block, Cells):
                shown.append(new_table(*block.heads, rows=block.rows))
            elif isinstance(block, Sentences | Plain):
                shown += map(paragraph, block.said if isinstance(block, Sentences) else [block.plain])
    return [*shown, *note_lines(notes)]
