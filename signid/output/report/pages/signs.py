"""Page of recovered signs: absolute and signed torque, and segments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ....signs import Signs, SignSegment, Trace
from ....types import Array
from ..layout import CERTAIN, confidence
from ..plots.frame import BEFORE, FAINT, axis, curve, packed, render, thinned
from ..policy import plot_markup
from ..results.signs import part_name, proof_sentence
from ..sections import INK, Plot

MOST = 4000  # maximum number of points per line
PANEL, MARGINS = 200, 50  # height of a plot without and of its margins [pixels]
HOVER = "sign %{customdata[0]}, confidence %{customdata[3]}<br>%{customdata[1]} to %{customdata[2]} s<extra></extra>"
MODEL, UNCERTAIN, PLUS = "#c2689a", "#e3c21c", "#2f7fc1"
SHADES = (("+", "sign +", PLUS), ("−", "sign −", BEFORE), ("?", f"confidence below {CERTAIN}", UNCERTAIN))


def signs_page(signs: Signs, units: Sequence[str] = ()) -> str:
    """Render signs.html: absolute torque, segments and signed torque, in the unit of each joint if given."""
    parts, proof = sign_plots(signs, units), proof_sentence(signs)
    return render("signs.html", title="Torque signs", signs=signs, parts=parts, proof=proof)


def sign_plots(signs: Signs, units: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Plot each joint without recorded signs, per recording."""
    named = units or ["N.m or N"] * len(signs.joints)
    return [
        {"name": part_name(signs, part), "plots": [_plot(signs, part, j, named[j]) for j in signs.hidden]}
        for part in range(len(signs.traces) if signs.hidden else 0)
    ]


def _plot(signs: Signs, part: int, j: int, unit: str) -> Plot:
    trace, top = signs.traces[part], _top(signs.traces[part], j)
    data = [*_shades(signs, part, j, top), *_lines(signs, trace, j, unit)]
    layout = {
        "xaxis": axis("time [s]", range=_range(trace.t - trace.origin)),
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
    """Segments of each sign, and uncertain ones, as bars of full height."""
    t, shades = signs.traces[part].t, {kind: list[SignSegment]() for kind, _, _ in SHADES}
    for segment in signs.of(joint):
        if segment.part == part:
            shades[_mark(segment) if segment.confidence >= CERTAIN else "?"].append(segment)
    wide = float(np.median(np.diff(t))) if len(t) > 1 else 1.0  # minimum width, for segments of a single sample
    origin = signs.traces[part].origin
    return [_bars(shades[kind], name, colour, top, wide, origin) for kind, name, colour in SHADES]


def _bars(
    some: Sequence[SignSegment], name: str, colour: str, top: float, wide: float, origin: float
) -> dict[str, Any]:
    shown = [[_mark(s), f"{s.start - origin:.6g}", f"{s.end - origin:.6g}", confidence(s.confidence)] for s in some]
    return {
        "type": "bar",
        "x": [(segment.start + segment.end) / 2 - origin for segment in some],
        "width": [segment.end - segment.start + wide for segment in some],
        "y": [2 * top] * len(some),
        "base": -top,
        "marker": {"color": colour, "opacity": 0.3 if colour == UNCERTAIN else 0.2, "line": {"width": 0}},
        "text": [plot_markup("$mark<br>$sure", mark=mark, sure=sure) for mark, _, _, sure in shown],
        "textposition": "inside",
        "insidetextanchor": "end",
        "textangle": 0,
        "textfont": {"color": INK, "size": 11},
        "customdata": shown,
        "hovertemplate": plot_markup(HOVER),
        "name": name,
    }


def _mark(segment: SignSegment) -> str:
    return "+" if segment.sign > 0 else "−"


def _lines(signs: Signs, trace: Trace, joint: int, unit: str) -> list[dict[str, Any]]:
    """Absolute torque, threshold, signed torque, and torque of the model."""
    size, level = trace.magnitude[:, joint], float(signs.threshold[joint])
    styles = (
        ("model", trace.predicted[:, joint], {"color": MODEL, "width": 3}),
        ("absolute torque", size, {"color": FAINT, "width": 1}),
        ("signed torque", size * trace.signs[:, joint], {"color": INK, "width": 1.2}),
    )
    lines = []
    for name, values, style in styles:
        x, y = thinned(trace.t - trace.origin, values[:, None], trace.first, MOST)
        hover = plot_markup("%{y:.4g} $unit at %{x:.6g} s<extra>$name</extra>", unit=unit, name=name)
        lines.append(curve(name, packed(x), packed(y[:, 0]), style, hovertemplate=hover))
    ends = (trace.t[[0, -1]] - trace.origin).tolist() if len(trace.t) else []
    dashed = {"color": FAINT, "width": 1, "dash": "dash"}
    return [lines[0], curve("threshold", ends, [level] * len(ends), dashed, hoverinfo="skip"), *lines[1:]]
