"""Signs that were recovered, as a page for the browser: torque without and with its sign, and the segments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ....signs import Signs, SignSegment, Trace
from ....types import Array
from ..results.signs import CERTAIN, confidence, part_name, proof_sentence
from .frame import BEFORE, FAINT, INK, Plot, axis, packed, render, thinned

MOST = 4000  # points a line
PANEL, MARGINS = 200, 50  # [pixels] height of a joint's panel, and of what stands around it
MODEL, DOUBT, PLUS = "#c2689a", "#e3c21c", "#2f7fc1"
SHADES = (("+", "sign +", PLUS), ("−", "sign −", BEFORE), ("?", f"confidence below {CERTAIN}", DOUBT))


class Part(NamedTuple):
    """What is drawn of a recording."""

    name: str
    plots: list[Plot]


def signs_page(signs: Signs, units: Sequence[str] = ()) -> str:
    """A page that needs nothing else: for each joint without a sign its absolute torque, segments, and signed torque.

    The same signs give the same bytes.

    Args:
        signs: as recovered.
        units: of the torque of each of the n joints; N.m or N where they are not told.
    """
    return render(
        "signs.html",
        title="Signs of torque",
        joints=[signs.joints[j] for j in signs.hidden],
        method=signs.method,
        proof=proof_sentence(signs),
        flags=signs.flags,
        notes=signs.notes,
        parts=sign_plots(signs, units),
        seed=signs.seed,
    )


def sign_plots(signs: Signs, units: Sequence[str] = ()) -> list[Part]:
    """Recording by recording, a plot for each joint whose torque had no sign.

    Args:
        signs: as recovered.
        units: of the torque of each of the n joints; N.m or N where they are not told.
    """
    told = units or ["N.m or N"] * len(signs.joints)
    return [
        Part(part_name(signs, part), [_plot(signs, part, j, told[j]) for j in signs.hidden])
        for part in range(len(signs.traces) if signs.hidden else 0)
    ]


def _plot(signs: Signs, part: int, j: int, unit: str) -> Plot:
    trace, top = signs.traces[part], _top(signs.traces[part], j)
    data = [*_shades(signs, part, j, top), *_lines(signs, trace, j, unit)]
    layout = {
        "xaxis": axis("time [s]", range=_range(trace.t)),
        "yaxis": axis(f"torque [{unit}]", range=[-top, top], nticks=7, zeroline=True, zerolinecolor=FAINT),
        "barmode": "overlay",
        "uniformtext": {"mode": "hide", "minsize": 10},
    }
    return Plot(signs.joints[j], data, layout, PANEL + MARGINS, wide=True)


def _range(t: Array) -> list[float] | None:
    if not len(t):
        return None
    room = 0.01 * float(t[-1] - t[0]) + 1e-9
    return [float(t[0]) - room, float(t[-1]) + room]


def _top(trace: Trace, joint: int) -> float:
    sizes = np.abs(np.concatenate([trace.magnitude[:, joint], trace.predicted[:, joint]]))
    return 1.4 * max(float(sizes[np.isfinite(sizes)].max(initial=0.0)), 1e-12)


def _shades(signs: Signs, part: int, joint: int, top: float) -> list[dict[str, Any]]:
    """Segments of each sign, and those in doubt, as bars from edge to edge."""
    own = [told for told in signs.of(joint) if told.part == part]
    t = signs.traces[part].t
    wide = float(np.median(np.diff(t))) if len(t) > 1 else 1.0  # a segment of a single sample is to be seen too
    return [
        _bars([told for told in own if _kind(told) == kind], name, colour, top, wide) for kind, name, colour in SHADES
    ]


def _bars(some: Sequence[SignSegment], name: str, colour: str, top: float, wide: float) -> dict[str, Any]:
    times = [[_mark(told), f"{told.start:.6g}", f"{told.end:.6g}", confidence(told.confidence)] for told in some]
    return {
        "type": "bar",
        "x": [(told.start + told.end) / 2 for told in some],
        "width": [told.end - told.start + wide for told in some],
        "y": [2 * top] * len(some),
        "base": -top,
        "marker": {"color": colour, "opacity": 0.3 if colour == DOUBT else 0.2, "line": {"width": 0}},
        "text": [f"{_mark(told)}<br>{confidence(told.confidence)}" for told in some],
        "textposition": "inside",
        "insidetextanchor": "end",
        "textangle": 0,
        "textfont": {"color": INK, "size": 11},
        "customdata": times,
        "hovertemplate": "sign %{customdata[0]}, confidence %{customdata[3]}<br>%{customdata[1]} to %{customdata[2]} s"
        "<extra></extra>",
        "name": name,
    }


def _kind(told: SignSegment) -> str:
    return _mark(told) if told.confidence >= CERTAIN else "?"


def _mark(told: SignSegment) -> str:
    return "+" if told.sign > 0 else "−"


def _lines(signs: Signs, trace: Trace, joint: int, unit: str) -> list[dict[str, Any]]:
    """Absolute torque, threshold, torque with its sign, and what the model says."""
    size, level = trace.magnitude[:, joint], float(signs.threshold[joint])
    styles = (
        ("model", trace.predicted[:, joint], {"color": MODEL, "width": 3}),
        ("absolute torque", size, {"color": FAINT, "width": 1}),
        ("torque with its sign", size * trace.signs[:, joint], {"color": INK, "width": 1.2}),
    )
    lines = []
    for name, values, style in styles:
        x, y = thinned(trace.t, values[:, None], trace.first, MOST)
        hover = f"%{{y:.4g}} {unit} at %{{x:.6g}} s<extra>{name}</extra>"
        line = {"type": "scatter", "mode": "lines", "name": name, "line": style, "hovertemplate": hover}
        lines.append({**line, "x": packed(x), "y": packed(y[:, 0])})
    ends = [float(t) for t in trace.t[[0, -1]]] if len(trace.t) else []
    dashed = {"color": FAINT, "width": 1, "dash": "dash"}
    at = {"type": "scatter", "mode": "lines", "name": "threshold", "line": dashed, "hoverinfo": "skip"}
    return [lines[0], {**at, "x": ends, "y": [level] * len(ends)}, *lines[1:]]
