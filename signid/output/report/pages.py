"""Rendering of self-contained pages: templates, style and script, and the parts of their plots."""

from __future__ import annotations

import gzip
from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...servos import Servo
from ...types import Array, Indices, Input, Robot
from ...version import __version__
from .documents import description, once
from .layout import content_policy, figure, plot_markup, share
from .sections import Card, Plot, Section

if TYPE_CHECKING:
    from ...servo.identify import ServoIdentification

TEMPLATES = Path(__file__).parent / "templates"
PLOTLY_FILE = "plotly-cartesian.min.js.gz"  # scatter, bar and heat map: 1.5 MB of a page, of Plotly's 4.8 MB
ORANGE, BLUE, GREEN, GREY = "#d1700e", "#2f7fc1", "#00876a", "#8a94a0"
AXIS_STYLE = {"showline": True, "linecolor": "#c5ccd3", "gridcolor": "#e3e8ec", "zeroline": False, "automargin": True}
DRY_FRICTION = ("coulomb_friction", "load_friction", "stribeck_level")
CURVE_POINTS = 121  # of a curve
REACHED_QUANTILE = 0.99  # quantile of speeds and torques of the recordings up to which curves are drawn
LOAD_SHARES = ((0.0, GREEN), (0.5, BLUE), (1.0, ORANGE))  # shares of the torque that was reached, and colours
FRICTION_LEGEND = (
    "Torque against the motion at steady speed by the model, up to the speeds and torques of the held-out "
    "data. Drive: the motor moves the load; back-drive: the load moves the motor. Joints without identifiable dry "
    "friction are not drawn, and viscous friction is left out where it is one number with kd."
)


def axis(title: str, **more: Any) -> dict[str, Any]:
    """Describe an axis of a plot, with further properties of Plotly."""
    return {**AXIS_STYLE, "title": {"text": title, "standoff": 8}, **more}


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
    scripts = [gzip.decompress((TEMPLATES / PLOTLY_FILE).read_bytes()).decode(), script]
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


def thinned(t: Array, lines: Array, first: Indices, max_points: int) -> tuple[Array, Array]:
    """Decimate lines over a common time; keep the extremes of each stretch.

    Lines are interrupted (NaN) where a span starts; t: (N,) [s], lines: (N, k) [any unit], first: (s,) first samples.
    """
    breaks = first[1:] if 6 * len(first) <= max_points else first[:0]
    if len(t) + len(breaks) > max_points:
        extremes = 2 * lines.shape[1]
        size = -(-extremes * len(t) // max(max_points - (extremes + 1) * (len(breaks) + 1), extremes))
        spans = np.split(np.arange(len(t)), breaks)
        parts = [part for span in spans for part in np.split(span, np.arange(size, len(span), size))]
        full = np.nan_to_num(lines)
        ends = [part[f(full[part], axis=0)] for part in parts if len(part) for f in (np.argmin, np.argmax)]
        kept = np.unique(np.concatenate(ends))
        breaks, t, lines = np.searchsorted(kept, breaks), t[kept], lines[kept]
    return np.insert(t, breaks, t[breaks]), np.insert(lines, breaks, np.nan, axis=0)


def friction_plots(result: ServoIdentification, joints: Sequence[str]) -> list[Plot]:
    """Plot friction against speed for some loads, of each of the joints with identifiable dry friction."""
    plots = []
    for drive in result.joints:
        if drive.joint not in joints:
            continue
        numbers, servo = drive.numbers, result.servos[drive.joint]
        known = {name for name, number in numbers.items() if number.value}
        speed, torque = _reached(result, drive.joint, servo)
        if not known.intersection(DRY_FRICTION) or not speed > 0:
            continue
        split = "viscous_friction" in known
        v = np.linspace(-speed, speed, CURVE_POINTS)
        v[CURVE_POINTS // 2] = np.nan  # friction at rest is between the two sides
        unit = "N" if result.robot.prismatic[result.robot.index(drive.joint)] else "N.m"
        data, loads = [], LOAD_SHARES if servo.load_friction > 0 and torque > 0 else LOAD_SHARES[:1]
        for part, colour in loads:
            load = float(figure(part * torque, 2))
            name = f"load {figure(load, 2)} {unit}" if len(loads) > 1 else "any load"
            hover = plot_markup("$name: %{y:.3g} $unit at %{x:.3g}<extra></extra>", name=name, unit=unit)
            y = steady_friction(servo, v, load, servo.viscous_friction if split else 0.0)
            line = {"color": colour, "width": 2}
            data.append(curve(name, packed(v), packed(y), line, hovertemplate=hover))
        corner = {"xref": "paper", "yref": "paper", "y": 0.02, "showarrow": False, "font": {"color": "#5b6773"}}
        layout = {
            "xaxis": axis(f"speed [{'m/s' if unit == 'N' else 'rad/s'}]", nticks=6, zeroline=True),
            "yaxis": axis(f"friction [{unit}]", nticks=6, zeroline=True),
            "annotations": [
                {**corner, "text": "back-drive", "x": 0.02, "xanchor": "left", "y": 0.98},
                {**corner, "text": "drive", "x": 0.98, "xanchor": "right"},
            ],
            "showlegend": True,
            "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
        }
        shown, damping = "dry and viscous friction" if split else "dry friction", numbers.get("damping")
        if not split and damping is not None and damping.value is not None:
            shown += f"; viscous at most {figure(damping.value, 2)} {damping.unit}"
        plots.append(Plot(f"{drive.joint}: {shown}", data, layout))
    return plots


def steady_friction(servo: Servo, v: Array, load: float, viscous: float) -> Array:
    """Friction torque (N,) [N.m or N] at steady speeds v (N,) [rad/s or m/s] against a load that turns the joint back.

    It solves F = dry + viscous |v| + m |load + sign(v) F|, with the friction m of the torque of the motor: |tau| is
    larger while the motor drives the load. NaN where no torque moves the joint.

    load: [N.m or N], not negative; viscous: coefficient [N.m.s/rad or N.s/m].
    """
    m = servo.load_friction
    dry = servo.coulomb_friction + servo.stribeck_level * np.exp(-((v / servo.stribeck_velocity) ** 2))
    dry = np.maximum(dry, 0.0) + viscous * np.abs(v)
    locked = np.full_like(v, np.nan)
    drive = (dry + m * load) / (1 - m) if m < 1 else locked
    braked = (dry + m * load) / (1 + m)  # the motor brakes the load
    pushed = (dry - m * load) / (1 - m) if m < 1 else locked  # friction alone holds the load, and the motor pushes
    return np.asarray(np.where(v > 0, drive, -np.where(braked <= load, braked, pushed)))


def _reached(result: ServoIdentification, joint: str, servo: Servo) -> tuple[float, float]:
    """Speed [rad/s or m/s] and torque of the drive [N.m or N] that the held-out recordings reach."""
    speeds, torques = [np.zeros(1)], [np.zeros(1)]
    for trace in result.traces:
        j = trace.joints.index(joint)
        if len(trace.t) > 1:
            speeds.append(np.abs(np.gradient(trace.simulated[:, j], trace.t)))
            torques.append(np.abs(servo.kp * (trace.command[:, j] - trace.measured[:, j])))
    speed, torque = (float(np.nanquantile(np.concatenate(x), REACHED_QUANTILE)) for x in (speeds, torques))
    return speed, min(torque, servo.effort_limit)
