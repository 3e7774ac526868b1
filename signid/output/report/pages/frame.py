"""A page from a template: its letters and colours, its plots, and the script that draws them, all in one file."""

from __future__ import annotations

import json
from base64 import b64encode
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ....types import Array, Indices
from ..numbers import determination, figure, share, with_interval
from ..results.signs import confidence

TEMPLATES = Path(__file__).parent / "templates"
BEFORE, AFTER, FLOOR, INK, FAINT = "#d1700e", "#2f7fc1", "#00876a", "#1f2933", "#8a94a0"
AXIS = {"showline": True, "linecolor": "#c5ccd3", "gridcolor": "#e3e8ec", "zeroline": False, "automargin": True}
FONT = {"family": "system-ui, Segoe UI, Helvetica, Arial, sans-serif", "size": 12, "color": INK}


class Plot(NamedTuple):
    """One drawing: Plotly's traces and layout."""

    name: str  # in words, for those who cannot see it
    data: list[dict[str, Any]]
    layout: dict[str, Any]
    height: int = 240  # [pixels]
    wide: bool = False  # over the whole width

    @property
    def text(self) -> str:
        """As JSON that can stand within a page."""
        layout = {"font": FONT, "showlegend": False, "hovermode": "closest", **PLAIN, **self.layout}
        whole = {"data": self.data, "layout": {**layout, "height": self.height}}
        return json.dumps(whole, separators=(",", ":"), ensure_ascii=True).replace("<", "\\u003c")


PLAIN = {
    "paper_bgcolor": "rgba(0,0,0,0)",
    "plot_bgcolor": "rgba(0,0,0,0)",
    "margin": {"l": 8, "r": 10, "t": 10, "b": 8},
}


def axis(title: str, **more: Any) -> dict[str, Any]:
    """An axis of a plot; its title ends with the unit.

    Args:
        title: in words.
        more: what else Plotly is told of it.
    """
    return {**AXIS, "title": {"text": title, "standoff": 8}, **more}


def packed(values: Array) -> dict[str, Any]:
    """Numbers as Plotly reads them, in four bytes each.

    Args:
        values: (k,) or (k, m) [any unit].
    """
    array = np.asarray(values)
    whole = {"dtype": "f4", "bdata": b64encode(np.ascontiguousarray(array, "<f4").tobytes()).decode()}
    return whole if array.ndim == 1 else {**whole, "shape": ", ".join(map(str, array.shape))}


def render(template: str, **content: Any) -> str:
    """A page that needs nothing else; the same content gives the same bytes.

    Args:
        template: its name.
        content: what the template asks for; text is escaped.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from plotly.offline import get_plotlyjs

    jinja = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    for made in (figure, share, determination, with_interval, confidence):
        jinja.filters[made.__name__] = made
    texts = {name: (TEMPLATES / f"page.{name}").read_text(encoding="utf-8") for name in ("css", "js")}
    return jinja.get_template(template).render(plotly=get_plotlyjs(), **texts, **content)


def thinned(t: Array, lines: Array, first: Indices, most: int) -> tuple[Array, Array]:
    """At most so many points of several lines over the same time, the extremes of each stretch of every line kept.

    Lines are broken (NaN) where a span begins.

    Args:
        t: (N,) [s].
        lines: (N, k) [any unit].
        first: where a span begins.
        most: points a line.
    """
    breaks = first[1:] if 6 * len(first) <= most else first[:0]
    if len(t) + len(breaks) > most:
        extremes = 2 * lines.shape[1]
        size = -(-extremes * len(t) // max(most - (extremes + 1) * (len(breaks) + 1), extremes))
        spans = np.split(np.arange(len(t)), breaks)
        parts = [part for span in spans for part in np.split(span, np.arange(size, len(span), size))]
        full = np.nan_to_num(lines)
        ends = [part[f(full[part], axis=0)] for part in parts if len(part) for f in (np.argmin, np.argmax)]
        kept = np.unique(np.concatenate(ends))
        breaks, t, lines = np.searchsorted(kept, breaks), t[kept], lines[kept]
    return np.insert(t, breaks, t[breaks]), np.insert(lines, breaks, np.nan, axis=0)
