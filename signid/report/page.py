"""What all pages for the browser share: head, lists, and how axes and letters look."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

INK = "#1f2933"
STYLE = """
body { font: 15px/1.5 system-ui, "Segoe UI", Helvetica, Arial, sans-serif; color: #1f2933; background: #fff; margin: 0 }
"""
FONT = {"family": "system-ui, Segoe UI, Helvetica, Arial, sans-serif", "size": 13, "color": INK}
AXES = {"showline": True, "linecolor": "#c5ccd3", "gridcolor": "#eef1f4"}


def whole_page(title: str, style: str, parts: Iterable[str]) -> str:
    """A page that needs nothing else, Plotly's script in its head.

    Args:
        title: in words.
        style: what it has beside the common style.
        parts: of its body, in HTML.
    """
    from plotly.offline import get_plotlyjs

    return "\n".join([
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(title)}</title>',
        f"<style>{STYLE}{style}</style>\n<script>{get_plotlyjs()}</script>\n</head>\n<body>\n<main>",
        *parts,
        "</main>\n</body>\n</html>\n",
    ])  # fmt: skip


def bullets(kind: str, sentences: Sequence[str]) -> str:
    """A list of sentences, each once; nothing where there are none."""
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in dict.fromkeys(sentences))
    return f'<ul class="{kind}">{items}</ul>' if items else ""
