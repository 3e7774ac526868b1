"""A diagnosis as a page for the browser: verdict, findings, rivals, and the residual before and after."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..diagnose import Diagnosis
from ..laws import spoken
from ..types import Array
from .diagnosis_words import (
    alternative_words,
    finding_words,
    place_words,
    role_words,
    trust_words,
    unexplained_words,
    verdict_words,
)
from .numbers import figure
from .page import AXES, FONT, bullets, whole_page

if TYPE_CHECKING:
    import plotly.graph_objects as go

FAINT, BEFORE, AFTER, FLOOR = "#8a94a0", "#dde2e7", "#2f6fb3", "#e07b39"
MARKS = ("before", "with what was lacking")
ROOM = 1.3  # times, beyond the outermost marks
ROW, MARGINS = 34, 150  # [pixels] height of a joint, and of what stands around all of them
STYLE = """\
main { max-width: 1180px; margin: 0 auto; padding: 24px }
h1 { font-size: 22px; line-height: 1.3; margin: 0 0 4px; padding: 14px 18px; border-radius: 6px; background: #eaf1f9 }
h1.nothing_missing { background: #e9f6ec } h1.unknown { background: #fdf3dc }
h2 { font-size: 16px; margin: 28px 0 4px } p { margin: 4px 0 } li { overflow-wrap: anywhere }
ul { margin: 8px 0; padding: 0 0 0 20px } ul.flags, ul.notes { padding: 10px 16px 10px 32px; border-radius: 6px }
.flags { background: #fdecea; color: #8c1d18 } .notes, .foot { color: #4a5560 } .notes { background: #f3f5f7 }
table { border-collapse: collapse; width: 100% }
td, th { text-align: left; padding: 5px 14px 5px 0; vertical-align: top }
th { color: #4a5560; font-weight: 500 } tr { border-bottom: 1px solid #e4e8ec } td:first-child { font-weight: 600 }
td { white-space: pre-line; font-variant-numeric: tabular-nums }
"""


class _Panel(NamedTuple):
    """A mark for every joint before, and one after."""

    title: str
    joints: Sequence[str]
    values: tuple[Array, Array]  # (n,) each, before and after [1, or unit]
    told: tuple[Array, Array]  # (n,) each [unit]
    unit: Sequence[str]
    line: float | None  # drawn across


def diagnosis_page(result: Diagnosis) -> str:
    """A page that needs nothing else; the same diagnosis gives the same bytes.

    Args:
        result: the diagnosis.
    """
    title = f"{result.robot.name}: {verdict_words(result)}"
    read = ", ".join(path for path, _ in result.inputs if path)
    return whole_page(title, STYLE, [
        f'<h1 class="{result.verdict}">{escape(title)}</h1>',
        bullets("flags", result.flags),
        *_section("Where simulation and recordings differ", place_words(result)),
        *_findings(result),
        *(f"<p>{escape(sentence)}</p>" for sentence in trust_words(result)),
        "<h2>Before and after, on recordings that were held out</h2>",
        _drawn(result),
        *_section("Left unexplained", unexplained_words(result)),
        bullets("notes", result.notes),
        f'<p class="foot">{escape(read)}; torque below {figure(result.cutoff)} Hz; seed {result.seed}</p>',
    ])  # fmt: skip


def _section(title: str, sentences: Sequence[str]) -> list[str]:
    return [f"<h2>{escape(title)}</h2>", bullets("said", sentences)] if sentences else []


def _findings(result: Diagnosis) -> Iterator[str]:
    """A table for each role, and below it the rivals of what stands in it."""
    for role, title in role_words(result).items():
        some = [finding for finding in result.findings if finding.role == role]
        if not some:
            continue
        heads = "".join(f"<th>{head}</th>" for head in ("law", "numbers, ± 95 %", "probability", "of torque", "mostly"))
        words = (finding_words(result.robot, finding) for finding in some)
        rows = ((law, "\n".join(numbers), *cells) for law, numbers, *cells in words)
        body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
        yield f"<h2>{title}</h2>\n<table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>"
        for finding in some:
            if said := alternative_words(result.robot, finding):
                yield f"<p>{escape(spoken(finding.law, result.robot))},</p>"
                yield bullets("said", said)


def _drawn(result: Diagnosis) -> str:
    """Held-out residual over the noise floor, and the error of roll-outs, from before to after."""
    from plotly.subplots import make_subplots

    panels = list(_panels(result))
    titles = [panel.title for panel in panels]
    height = ROW * len(result.before.joints) + MARGINS
    drawn = make_subplots(1, len(panels), shared_yaxes=True, horizontal_spacing=0.04, subplot_titles=titles)
    for column, panel in enumerate(panels, 1):
        for line in _lines(panel):
            drawn.add_trace(line.update(showlegend=column == 1 and bool(line.name)), row=1, col=column)
        if panel.line is not None:
            drawn.add_vline(panel.line, line={"color": FLOOR, "width": 2, "dash": "dash"}, row=1, col=column)
        drawn.update_xaxes(range=_range(panel), row=1, col=column)
    drawn.update_xaxes(type="log", **AXES, dtick="D2", tickformat="~g")
    drawn.update_yaxes(autorange="reversed", **AXES)
    drawn.update_layout(
        template="none",
        height=height,
        margin={"l": 10, "r": 16, "t": 84, "b": 40},
        yaxis={"automargin": True},
        font=FONT,
        legend={"orientation": "h", "x": 0, "y": 1, "yanchor": "top", "yref": "container"},
    ).update_annotations(font_size=14)
    config = {"responsive": True, "displayModeBar": False}
    told = {"include_plotlyjs": False, "full_html": False, "div_id": "residual", "default_height": f"{height}px"}
    return str(drawn.to_html(config, **told))


def _panels(result: Diagnosis) -> Iterator[_Panel]:
    before, after, floor = result.before, result.after, result.before.noise_floor
    told = before.held_out_rms, after.held_out_rms
    title = "unexplained torque, times the noise floor (dashed: 1)"
    yield _Panel(title, before.joints, (told[0] / floor, told[1] / floor), told, before.unit, 1.0)
    first, last = result.rollout_before, result.rollout_after
    if first is not None and last is not None:
        horizon = max(first.horizons)
        errors = first.rms(horizon), last.rms(horizon)
        title = f"error after {horizon:g} s of simulation [{' or '.join(dict.fromkeys(first.unit))}]"
        yield _Panel(title, first.joints, errors, errors, first.unit, None)


def _range(panel: _Panel) -> list[float] | None:
    """Of a logarithmic axis that holds every mark and the line."""
    shown = np.array([*panel.values, np.full(len(panel.joints), np.nan if panel.line is None else panel.line)])
    shown = shown[np.isfinite(shown) & (shown > 0)]
    return [float(np.log10(shown.min() / ROOM)), float(np.log10(shown.max() * ROOM))] if len(shown) else None


def _lines(panel: _Panel) -> Iterator[go.Scatter]:
    """The way from before to after, and a mark at either end."""
    import plotly.graph_objects as go

    y = [escape(joint) for joint in panel.joints]
    before, after = ([float(x) if np.isfinite(x) else None for x in values] for values in panel.values)
    ways = [x for b, a in zip(before, after, strict=True) for x in (b, a, None)]
    grey = {"color": BEFORE, "width": 4}
    yield go.Scatter(x=ways, y=[j for j in y for _ in range(3)], mode="lines", line=grey, hoverinfo="skip")
    for name, colour, x, told in zip(MARKS, (FAINT, AFTER), (before, after), panel.told, strict=True):
        shown = [f"{figure(float(value))} {unit}" for value, unit in zip(told, panel.unit, strict=True)]
        mark = {"color": colour, "size": 13}
        hover = f"%{{y}} {name}: %{{customdata}}<extra></extra>"
        yield go.Scatter(x=x, y=y, mode="markers", marker=mark, name=name, customdata=shown, hovertemplate=hover)
