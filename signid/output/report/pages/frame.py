"""Rendering of self-contained pages: templates, style, plots and script."""

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
    """A plot: traces and layout for Plotly."""

    name: str  # caption and text alternative
    data: list[dict[str, Any]]
    layout: dict[str, Any]
    height: int = 240  # [pixels]
    wide: bool = False  # full width of the page

    @property
    def text(self) -> str:
        """JSON text, safe inside a page."""
        layout = {"font": FONT, "showlegend": False, "hovermode": "closest", **PLAIN, **self.layout}
        whole = {"data": self.data, "layout": {**layout, "height": self.height}}
        return json.dumps(whole, separators=(",", ":"), ensure_ascii=True).replace("<", "\\u003c")


PLAIN = {
    "paper_bgcolor": "rgba(0,0,0,0)",
    "plot_bgcolor": "rgba(0,0,0,0)",
    "margin": {"l": 8, "r": 10, "t": 10, "b": 8},
}


def axis(title: str, **more: Any) -> dict[str, Any]:
    """Describe an axis of a plot.

    Args:
        title: title with unit.
        more: further properties of Plotly.
    """
    return {**AXIS, "title": {"text": title, "standoff": 8}, **more}


def packed(values: Array) -> dict[str, Any]:
    """Encode numbers for Plotly, four bytes each.

    Args:
        values: (k,) or (k, m) [any unit].
    """
    array = np.asarray(values)
    whole = {"dtype": "f4", "bdata": b64encode(np.ascontiguousarray(array, "<f4").tobytes()).decode()}
    return whole if array.ndim == 1 else {**whole, "shape": ", ".join(map(str, array.shape))}


def render(template: str, **content: Any) -> str:
    """Render a self-contained page, reproducible to the byte.

    Args:
        template: name of the template.
        content: variables of the template; text is escaped.
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
    """Decimate lines over a common time; keep the extremes of each stretch.

    Lines are interrupted (NaN) at the start of each span.

    Args:
        t: (N,) [s].
        lines: (N, k) [any unit].
        first: index of the first sample of each span.
        most: maximum number of points per line.
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
