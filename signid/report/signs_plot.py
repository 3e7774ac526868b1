"""Signs that were recovered, as a page for the browser: torque without and with its sign, and the segments."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from ..signs import Signs, Told, Trace
from ..types import Array, Indices
from .page import AXES, FONT, INK, bullets, whole_page
from .signs import CERTAIN, confidence, part_name, proof_sentence

if TYPE_CHECKING:
    import plotly.graph_objects as go

MOST = 4000  # points a line
PANEL, MARGINS = 230, 130  # [pixels] height of a joint's panel, and of what stands around all of them
FAINT, MODEL = "#8a94a0", "#e58fb3"
SHADES = (("+", "sign +", "#2f6fb3"), ("−", "sign −", "#e07b39"), ("?", f"confidence below {CERTAIN}", "#e3c21c"))
STYLE = """\
main { max-width: 1280px; margin: 0 auto; padding: 24px }
h1 { font-size: 22px; margin: 0 0 4px } h2 { font-size: 16px; margin: 28px 0 0; overflow-wrap: anywhere }
p { margin: 4px 0 } ul { margin: 12px 0; padding: 10px 16px 10px 32px; border-radius: 6px }
.flags { background: #fdecea; color: #8c1d18 } .notes { background: #f3f5f7; color: #4a5560 }
"""


def signs_page(signs: Signs, units: Sequence[str] = ()) -> str:
    """A page that needs nothing else: for each joint without a sign its absolute torque, segments, and signed torque.

    The same signs give the same bytes.

    Args:
        signs: as recovered.
        units: of the torque of each of the n joints; N.m or N where they are not told.
    """
    told = units or ["N.m or N"] * len(signs.joints)
    shaded = "Shaded: segments, each with its sign and confidence. Elsewhere signs follow the model, sample by sample."
    sections = [_section(signs, part, told) for part in range(len(signs.traces) if signs.hidden else 0)]
    hidden = ", ".join(signs.joints[j] for j in signs.hidden)
    return whole_page("Signs of torque", STYLE, [
        "<h1>Signs of torque that was recorded without them</h1>",
        f"<p>Joints: {escape(hidden)}. Method: {escape(signs.method)}. {escape(proof_sentence(signs))}</p>",
        bullets("flags", signs.flags),
        bullets("notes", signs.notes),
        f"<p>{shaded}</p>",
        *sections,
    ])  # fmt: skip


def _section(signs: Signs, part: int, units: Sequence[str]) -> str:
    """One recording."""
    name = f"<h2>{escape(part_name(signs, part))}</h2>\n" if len(signs.traces) > 1 or signs.traces[part].path else ""
    drawn = _figure(signs, part, units)
    config = {"responsive": True, "displaylogo": False}
    height = f"{drawn.layout.height}px"
    shown = drawn.to_html(
        config, include_plotlyjs=False, full_html=False, div_id=f"signs-{part + 1}", default_height=height
    )
    return f"<section>\n{name}{shown}\n</section>"


def _figure(signs: Signs, part: int, units: Sequence[str]) -> go.Figure:
    """A panel for each joint, one below the other, over the same time."""
    from plotly.subplots import make_subplots

    count = len(signs.hidden)
    height = PANEL * count + MARGINS
    drawn = make_subplots(count, 1, shared_xaxes=True, vertical_spacing=16 / height)
    named: set[str] = set()
    for row, j in enumerate(signs.hidden, 1):
        trace, top = signs.traces[part], _top(signs.traces[part], j)
        for line in (*_shades(signs, part, j, top), *_lines(signs, trace, j, units[j])):
            drawn.add_trace(line.update(showlegend=len(line.x) > 0 and line.name not in named), row=row, col=1)
            named |= {line.name} if len(line.x) else set()
        title = f"{escape(signs.joints[j])} [{units[j]}]"
        drawn.update_yaxes(title_text=title, range=[-top, top], row=row, col=1)
    drawn.update_xaxes(title_text="time [s]", row=count, col=1)
    drawn.update_xaxes(range=_range(signs.traces[part].t), **AXES, zeroline=False)
    drawn.update_yaxes(**AXES, zerolinecolor=AXES["linecolor"], nticks=7)
    return drawn.update_layout(
        template="none",
        height=height,
        margin={"l": 80, "r": 16, "t": 56, "b": 52},
        font=FONT,
        legend={"orientation": "h", "x": 0, "y": 1, "yanchor": "bottom", "yref": "paper"},
        barmode="overlay",
        hovermode="closest",
        uniformtext={"mode": "hide", "minsize": 10},
    )


def _range(t: Array) -> list[float] | None:
    if not len(t):
        return None
    room = 0.01 * float(t[-1] - t[0]) + 1e-9
    return [float(t[0]) - room, float(t[-1]) + room]


def _top(trace: Trace, joint: int) -> float:
    sizes = np.abs(np.concatenate([trace.magnitude[:, joint], trace.predicted[:, joint]]))
    return 1.4 * max(float(sizes[np.isfinite(sizes)].max(initial=0.0)), 1e-12)


def _shades(signs: Signs, part: int, joint: int, top: float) -> list[go.Bar]:
    """Segments of each sign, and those in doubt, as bars from edge to edge."""
    import plotly.graph_objects as go

    own = [told for told in signs.of(joint) if told.part == part]
    kinds = [_kind(told) for told in own]
    t = signs.traces[part].t
    wide = float(np.median(np.diff(t))) if len(t) > 1 else 1.0  # a segment of a single sample is to be seen too
    bars = []
    for kind, name, colour in SHADES:
        some = [told for told, each in zip(own, kinds, strict=True) if each == kind]
        bars.append(
            go.Bar(
                x=[(told.start + told.end) / 2 for told in some],
                width=[told.end - told.start + wide for told in some],
                y=[2 * top] * len(some),
                base=-top,
                marker={"color": colour, "opacity": 0.25 if kind == "?" else 0.16, "line": {"width": 0}},
                text=[f"{_mark(told)}<br>{confidence(told.confidence)}" for told in some],
                textposition="inside",
                insidetextanchor="end",
                textangle=0,
                textfont={"color": INK, "size": 11},
                customdata=[
                    [_mark(told), f"{told.start:.6g}", f"{told.end:.6g}", confidence(told.confidence)] for told in some
                ],
                hovertemplate="sign %{customdata[0]}, confidence %{customdata[3]}<br>"
                f"%{{customdata[1]}} to %{{customdata[2]}} s<extra>{escape(signs.joints[joint])}</extra>",
                name=name,
                legendgroup=name,
                legendrank=1,
            )
        )
    return bars


def _kind(told: Told) -> str:
    return _mark(told) if told.confidence >= CERTAIN else "?"


def _mark(told: Told) -> str:
    return "+" if told.sign > 0 else "−"


def _lines(signs: Signs, trace: Trace, joint: int, unit: str) -> list[go.Scatter]:
    """Absolute torque, threshold, torque with its sign, and what the model says."""
    import plotly.graph_objects as go

    size, level = trace.magnitude[:, joint], float(signs.threshold[joint])
    lines = (
        ("model", trace.predicted[:, joint], {"color": MODEL, "width": 3}),
        ("absolute torque", size, {"color": FAINT, "width": 1, "dash": "solid"}),
        ("torque with its sign", size * trace.signs[:, joint], {"color": INK, "width": 1.2}),
    )
    drawn = []
    for name, y, style in lines:
        x, y = _thinned(trace.t, y, trace.first)
        more = {"name": name, "legendgroup": name, "mode": "lines", "line": style}
        hover = f"%{{y:.4g}} {unit} at %{{x:.6g}} s<extra>{name}</extra>"
        drawn.append(go.Scatter(x=x, y=y.astype(np.float32), hovertemplate=hover, **more))
    ends = [float(t) for t in trace.t[[0, -1]]] if len(trace.t) else []
    dashed = {"color": FAINT, "width": 1, "dash": "dash"}
    at = go.Scatter(x=ends, y=[level] * len(ends), mode="lines", line=dashed, name="threshold", hoverinfo="skip")
    return [drawn[0], at.update(legendgroup="threshold"), *drawn[1:]]


def _thinned(t: Array, y: Array, first: Indices) -> tuple[Array, Array]:
    """At most 4000 points of a line (N,), the least and the greatest of each stretch, broken where a span begins."""
    breaks = first[1:] if 6 * len(first) <= MOST else first[:0]
    if len(t) + len(breaks) > MOST:
        size = -(-2 * len(t) // (MOST - 3 * len(breaks) - 3))
        spans = np.split(np.arange(len(t)), breaks)
        parts = [part for span in spans for part in np.split(span, np.arange(size, len(span), size))]
        ends = [part[[f(np.nan_to_num(y[part])) for f in (np.argmin, np.argmax)]] for part in parts if len(part)]
        kept = np.unique(np.concatenate(ends))
        breaks, t, y = np.searchsorted(kept, breaks), t[kept], y[kept]
    return np.insert(t, breaks, t[breaks]), np.insert(y, breaks, np.nan)
