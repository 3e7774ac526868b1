"""Several plots of a page in one Plotly figure, each in a cell of its own."""

from __future__ import annotations

from base64 import b64decode
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ..report.sections import Plot

ABOVE, BELOW = 30, 46  # room for the title and for the axis of a plot [pixels]
BESIDE = 0.09  # room left of a plot for its axis where plots stand side by side, as a share of the width
TOP = 40  # room for the legend [pixels]


def compose(plots: Sequence[Plot], columns: int = 1) -> Any:
    """A Plotly figure of plots in rows of `columns`; their arrays are NumPy arrays, and names appear once."""
    import plotly.graph_objects as go

    from ..report.policy import escaped
    from ..report.sections import FONT, Plot

    rows = [plots[k : k + columns] for k in range(0, len(plots), columns)]
    heights = [max(plot.height for plot in row) + ABOVE for row in rows]
    total, top = sum(heights), 0
    data: list[dict[str, Any]] = []
    layout: dict[str, Any] = {"annotations": []}
    counts = {"x": 0, "y": 0}
    for row, height in zip(rows, heights, strict=True):
        y = (1 - (top + height - BELOW) / total, 1 - (top + ABOVE) / total)
        for k, plot in enumerate(row):
            x = (k / columns + (BESIDE if columns > 1 else 0), (k + 1) / columns - (0.01 if columns > 1 else 0))
            safe = Plot(*(escaped(part) for part in plot))
            _place(safe, x, y, counts, data, layout)
        top += height
    _legend(data)
    general = {"template": "plotly_white", "font": FONT, "height": total + TOP, "hovermode": "closest"}
    margin = {"l": 8, "r": 10, "t": TOP, "b": 8}
    legend = {"orientation": "h", "x": 0, "y": 1, "yanchor": "bottom"}
    return go.Figure({"data": data, "layout": {**general, "margin": margin, "legend": legend, **layout}})


def _place(
    plot: Plot,
    x: tuple[float, float],
    y: tuple[float, float],
    counts: dict[str, int],
    data: list[dict[str, Any]],
    layout: dict[str, Any],
) -> None:
    """Add a plot in a cell x, y (shares of the figure), with axes of its own numbers."""
    ids, axes = {"x": "", "y": ""}, [key for key in plot.layout if key[1:5] == "axis"]
    for key in axes:
        letter = key[0]
        counts[letter] += 1
        ids[letter + key[5:]] = f"{letter}{counts[letter] if counts[letter] > 1 else ''}"
    for key in axes:
        letter, old = key[0], plot.layout[key]
        low, high = x if letter == "x" else y
        domain = [low + (high - low) * end for end in old.get("domain", (0, 1))]
        anchor = ids[old.get("anchor", "y" if letter == "x" else "x")]
        layout[f"{letter}axis{ids[letter + key[5:]][1:]}"] = {**old, "domain": domain, "anchor": anchor}
    data += [
        {**unpacked(trace), "xaxis": ids[trace.get("xaxis", "x")], "yaxis": ids[trace.get("yaxis", "y")]}
        for trace in plot.data
    ]
    layout |= {key: value for key, value in plot.layout.items() if key not in axes}
    title = {"text": plot.name, "x": x[0], "y": y[1], "xref": "paper", "yref": "paper", "showarrow": False}
    layout["annotations"].append({**title, "xanchor": "left", "yanchor": "bottom", "font": {"size": 13}})


def unpacked(trace: Mapping[str, Any]) -> dict[str, Any]:
    """A trace whose encoded numbers are arrays again."""
    return {
        key: _array(value) if isinstance(value, dict) and "bdata" in value else value for key, value in trace.items()
    }


def _array(packed: Mapping[str, Any]) -> Any:
    values = np.frombuffer(b64decode(packed["bdata"]), "<f4")
    return values.reshape([int(n) for n in packed["shape"].split(", ")]) if "shape" in packed else values


def _legend(data: list[dict[str, Any]]) -> None:
    """Show each name once; lines of one name are switched together."""
    seen: set[str] = set()
    for trace in data:
        name = trace.get("name", "")
        trace["showlegend"] = bool(name) and name not in seen and trace["type"] != "heatmap"
        trace |= {"legendgroup": name} if name and trace["type"] != "heatmap" else {}
        seen.add(name)
