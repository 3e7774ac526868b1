"""Rendering of self-contained pages: templates, style, plots and script."""

from __future__ import annotations

import gzip
from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ....types import Array, Indices, Input, Robot
from ....version import __version__
from ..documents import description, once
from ..layout import share
from ..policy import content_policy
from ..sections import Card, Section

TEMPLATES = Path(__file__).parent / "templates"
PLOTLY = "plotly-cartesian.min.js.gz"  # scatter, bar and heat map: 1.5 MB of a page, of Plotly's 4.8 MB
BEFORE, AFTER, FLOOR, FAINT = "#d1700e", "#2f7fc1", "#00876a", "#8a94a0"
AXIS = {"showline": True, "linecolor": "#c5ccd3", "gridcolor": "#e3e8ec", "zeroline": False, "automargin": True}


def axis(title: str, **more: Any) -> dict[str, Any]:
    """Describe an axis of a plot, with further properties of Plotly."""
    return {**AXIS, "title": {"text": title, "standoff": 8}, **more}


def packed(values: Array) -> dict[str, Any]:
    """Encode numbers for Plotly, four bytes each; values: (k,) or (k, m) [any unit]."""
    array = np.asarray(values)
    whole = {"dtype": "f4", "bdata": b64encode(np.ascontiguousarray(array, "<f4").tobytes()).decode()}
    return whole if array.ndim == 1 else {**whole, "shape": ", ".join(map(str, array.shape))}


def render(template: str, **content: Any) -> str:
    """Render a template as a self-contained page, reproducible to the byte; text is escaped."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    spaces: dict[str, Any] = {"trim_blocks": True, "lstrip_blocks": True, "keep_trailing_newline": True}
    jinja = Environment(loader=FileSystemLoader(TEMPLATES), autoescape=True, undefined=StrictUndefined, **spaces)
    jinja.filters["share"] = share
    css, script = ((TEMPLATES / f"page.{name}").read_text(encoding="utf-8") for name in ("css", "js"))
    scripts = [gzip.decompress((TEMPLATES / PLOTLY).read_bytes()).decode(), script]
    return jinja.get_template(template).render(policy=content_policy(scripts), scripts=scripts, css=css, **content)


def shared(result: Any, robots: Iterable[Robot], inputs: Sequence[Input], command: str) -> dict[str, Any]:
    """Content of every page: result, input files (by default the descriptions of the robots), command, version."""
    files = once([*result.inputs, *(inputs or map(description, robots))])
    return {
        "result": result,
        "flags": result.flags,
        "notes": result.notes,
        "files": files,
        "command": command,
        "seed": result.seed,
        "version": __version__,
    }


class Header(NamedTuple):
    """Top of a page."""

    title: str
    over: str  # small line above the headline
    cards: Sequence[Card]
    kind: str = ""  # "unreliable", "unknown" or "nothing_missing"
    headline: str = ""  # "": the title


def sections_page(header: Header, sections: Sequence[Section], content: Mapping[str, Any]) -> str:
    """Render a page of sections; `content`: that of every page, `shared`."""
    top = {**header._asdict(), "headline": header.headline or header.title}
    return render("sections.html", sections=sections, **top, **content)


def curve(name: str, x: Any, y: Any, line: dict[str, Any], **hover: str) -> dict[str, Any]:
    """A line of a plot; `hover` is a template (PlotMarkup) or the mode of its hover text."""
    return {"type": "scatter", "mode": "lines", "name": name, "line": line, **hover, "x": x, "y": y}


def thinned(t: Array, lines: Array, first: Indices, most: int) -> tuple[Array, Array]:
    """Decimate lines over a common time; keep the extremes of each stretch.

    Lines are interrupted (NaN) where a span starts; t: (N,) [s], lines: (N, k) [any unit], first: (s,) first samples.
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
