"""Protection of pages: names never become markup, and a Content-Security-Policy forbids outside requests."""

from __future__ import annotations

import hashlib
import re
from base64 import b64encode
from collections.abc import Iterable, Mapping
from html import escape
from string import Template
from typing import Any

NO_CONNECTION = "connect-src 'none'"  # replaced in the page that a live replay serves


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
    hashes = " ".join(f"'sha256-{_digest(script)}'" for script in scripts)
    return (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; {NO_CONNECTION}; "
        "object-src 'none'; base-uri 'none'; form-action 'none'"
    )


def _digest(script: str) -> str:
    """SHA-256 of a script as a browser reads it, with line feeds alone, in base64."""
    return b64encode(hashlib.sha256(re.sub("\r\n?", "\n", script).encode()).digest()).decode()
