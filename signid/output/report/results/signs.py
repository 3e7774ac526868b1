"""Recovered signs: block of identification.json, terminal tables, signed.csv, and page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite
from typing import Any

import numpy as np
import polars as pl
from rich.console import RenderableType

from ....signs import Signs, SignSegment
from ....types import Array, Recording
from ....version import __version__
from ..documents import Document, picked
from ..layout import CERTAINTY, confidence, figure, plot_markup, plural, share, with_interval
from ..pages import GREY, ORANGE, Header, axis, curve, packed, sections_page, thinned
from ..sections import INK, Cells, Key, Plain, Plot, Plots, Section, terminal

ROWS_PER_WRITE = 65_536  # rows written at once
MAX_SIGN_POINTS = 4000  # maximum number of points per line
PANEL_HEIGHT, MARGIN_HEIGHT = 200, 50  # height of a plot without and of its margins [pixels]
HOVER = "sign %{customdata[0]}, confidence %{customdata[3]}<br>%{customdata[1]} to %{customdata[2]} s<extra></extra>"
PINK, YELLOW, PLUS_BLUE = "#c2689a", "#e3c21c", "#2f7fc1"
SHADES_LEGEND = "Shaded: segments with their sign and confidence. Elsewhere the sign of each sample follows the model."
SIGNS_KEY = (
    *(("plus", "sign +"), ("minus", "sign −"), ("uncertain", f"confidence below {CERTAINTY}")),
    *(("size", "absolute torque"), ("measured", "signed torque"), ("model", "model")),
)
SHADES = (("+", "sign +", PLUS_BLUE), ("−", "sign −", ORANGE), ("?", f"confidence below {CERTAINTY}", YELLOW))


def signs_document(signs: Signs) -> Document:
    """Build the signs block of identification.json."""
    hidden = list(signs.hidden)
    return {
        "proof": picked(signs.proof, "optimal gap nodes certified"),
        "flags": list(signs.flags),
        "segments": [
            {"joint": signs.joints[segment.joint], **picked(segment, "start end sign confidence")}
            | ({"recording": part_name(signs, segment.part)} if len(signs.traces) > 1 else {})
            for segment in signs.segments
        ],
        "method": signs.method,
        "joints": [signs.joints[j] for j in hidden],
        **{key: x[hidden].tolist() for key, x in picked(signs, "threshold noise inflation").items()},
        "gains": [
            {"joint": gain.joint, "torque_constant": float(gain.value), "std": float(gain.std), "unit": gain.unit}
            for gain in signs.gains
        ],
        "notes": list(signs.notes),
        "seed": int(signs.seed),
    }


def signs_tables(signs: Signs) -> list[RenderableType]:
    """Number of segments and confidence of their signs per joint, and the optimality proof."""
    return terminal(signs_sections(signs), ())


def signs_sections(signs: Signs) -> list[Section]:
    """Segments and confidence of their signs per joint, and torque constants that were unknown."""
    rows, searched = [], {segment.part for segment in signs.segments}
    total = sum(len(signs.traces[part].t) for part in searched)
    for j in signs.hidden:
        segments = signs.of(j)
        counts = [sum(segment.sign == sign for segment in segments) for sign in (1, -1)]
        uncertain = sum(not segment.confidence >= CERTAINTY for segment in segments)
        lowest = confidence(min((segment.confidence for segment in segments), default=float("nan")))
        times = [(signs.traces[segment.part].t, segment) for segment in segments]
        inside = sum(int(np.sum((t >= segment.start) & (t <= segment.end))) for t, segment in times)
        cells = (len(segments), *counts, uncertain, lowest, total, share(inside / total) if total else "-")
        rows.append((signs.joints[j], *map(str, cells)))
    heads = ("joint", "segments>", "+>", "->", "uncertain>", "lowest confidence>", "samples>", "in segments>")
    gains = [
        (joint, *(with_interval(value, std) if isfinite(std) else (figure(value), "-")), unit)
        for joint, value, std, unit in signs.gains
    ]
    return [
        Section("Torque signs", (Cells(heads, rows), Plain(proof_sentence(signs)))),
        Section("Unknown torque constants", (Cells(("joint", "torque constant>", "± (95 %)>", "unit"), gains),)),
    ]


def signed_csv(recording: Recording, signs: Signs, part: int) -> Iterator[str]:
    """Yield signed.csv in pieces: the recording's rows with t [s], and tau_J [N.m or N] and sure_J [1] of each joint.

    `sure_J` is the confidence of the segment of a row. It is 0 outside of segments, where the sign follows the model,
    and 1 for torques recorded with signs. Torques of segments whose sign is uncertain are missing; a joint without a
    certain one has abs_tau_J instead. Numbers are written exactly; missing numbers are empty cells. `part` is the index
    of the recording's trace.
    """
    columns = recording.columns["tau"]
    joints = [j for j, column in enumerate(columns) if column]
    lost = {j for j in signs.hidden if not any(segment.confidence >= CERTAINTY for segment in signs.of(j))}
    names = [*recording.columns["t"], *(columns[j] for j in joints)]
    scale = np.array([1.0, *recording.torque_per_unit[joints]])
    for start in range(0, max(1, len(recording)), ROWS_PER_WRITE):
        values = recording.table.read(names, start, start + ROWS_PER_WRITE) * scale + 0.0  # no -0
        t, *torques = np.ascontiguousarray(values.T)
        cells = {"t": t}
        for j, tau in zip(joints, torques, strict=True):
            name, sure = recording.joints[j], _row_confidence(signs, part, j, t, tau)
            known = np.where((sure > 0) & (sure < CERTAINTY), np.nan, tau)
            cells |= {f"abs_tau_{name}": np.abs(tau)} if j in lost else {f"tau_{name}": known}
            cells[f"sure_{name}"] = sure
        yield pl.DataFrame(cells).fill_nan(None).write_csv(include_header=start == 0)


def proof_sentence(signs: Signs) -> str:
    """Optimality of the signs in a sentence."""
    proof, nodes = signs.proof, plural(signs.proof.nodes, "node")
    if proof.optimal:
        way = "eigenvalues alone" if proof.certified else f"a search of {nodes}"
        return f"The signs of these segments are optimal, proved by {way}."
    if proof.has_bound:
        bound = f"Other signs of these segments could reduce the residual by at most {share(proof.gap)}"
        return f"{bound}; the search visited {nodes}."
    return f"The signs of these segments are not proved optimal: the search visited {nodes}."


def part_name(signs: Signs, part: int) -> str:
    """The path of a recording, or its number if it has none."""
    return signs.traces[part].path or f"recording {part + 1}"


def _row_confidence(signs: Signs, part: int, joint: int, t: Array, torque: Array) -> Array:
    """Confidence of the segment of each row with its sign, (N,) [1]."""
    if joint not in signs.hidden:
        return np.ones(len(t))
    segments = sorted((s.start, s.end, s.sign, s.confidence) for s in signs.of(joint) if s.part == part)
    start, end, sign, sure = np.array([(-np.inf, -np.inf, 0.0, 0.0), *segments]).T
    at = np.searchsorted(start, t, side="right") - 1
    return np.where((t <= end[at]) & (torque * sign[at] >= 0), sure[at], 0.0)


def signs_page(signs: Signs, units: Sequence[str] = ()) -> str:
    """Render signs.html: absolute torque, segments and signed torque, in the unit of each joint if given."""
    joints = f"Joints: {', '.join(signs.joints[j] for j in signs.hidden)}. Method: {signs.method}."
    header = Header("Torque signs", joints, (), headline="Recovered torque signs")
    content = {"flags": signs.flags, "notes": signs.notes, "files": (), "command": "", "seed": signs.seed}
    return sections_page(header, drawn_signs(signs, units), {**content, "version": __version__})


def drawn_signs(signs: Signs, units: Sequence[str] = (), level: int = 2) -> list[Section]:
    """Torque with its signs over time, a section a recording with headings of a level, for a page."""
    joint_units = units or ["N.m or N"] * len(signs.joints)
    parts = {
        part_name(signs, part): [_plot(signs, part, j, joint_units[j]) for j in signs.hidden]
        for part in range(len(signs.traces) if signs.hidden else 0)
    }
    named = [part for part in parts if len(parts) > 1 or not part.startswith("recording ")]
    first = Section("Torque signs", (Plain(proof_sentence(signs)), Plain(SHADES_LEGEND), Key(SIGNS_KEY)))
    shown = [Section(part if part in named else "", (Plots(plots),), level) for part, plots in parts.items()]
    return [first, *shown] if parts else []


def _plot(signs: Signs, part: int, j: int, unit: str) -> Plot:
    trace = signs.traces[part]
    sizes = np.abs(np.concatenate([trace.magnitude[:, j], trace.predicted[:, j]]))
    top = 1.4 * max(float(sizes[np.isfinite(sizes)].max(initial=0.0)), 1e-12)
    size, level = trace.magnitude[:, j], float(signs.threshold[j])
    styles = (
        ("model", trace.predicted[:, j], {"color": PINK, "width": 3}),
        ("absolute torque", size, {"color": GREY, "width": 1}),
        ("signed torque", size * trace.signs[:, j], {"color": INK, "width": 1.2}),
    )
    lines = []
    for name, values, style in styles:
        x, y = thinned(trace.t - trace.origin, values[:, None], trace.first, MAX_SIGN_POINTS)
        hover = plot_markup("%{y:.4g} $unit at %{x:.6g} s<extra>$name</extra>", unit=unit, name=name)
        lines.append(curve(name, packed(x), packed(y[:, 0]), style, hovertemplate=hover))
    edges = (trace.t[[0, -1]] - trace.origin).tolist() if len(trace.t) else []
    dashed = {"color": GREY, "width": 1, "dash": "dash"}
    threshold = curve("threshold", edges, [level] * len(edges), dashed, hoverinfo="skip")
    data = [*_shades(signs, part, j, top), lines[0], threshold, *lines[1:]]
    t, ends = trace.t - trace.origin, None
    if len(t):
        room = 0.01 * float(t[-1] - t[0]) + 1e-9
        ends = [float(t[0]) - room, float(t[-1]) + room]
    layout = {
        "xaxis": axis("time [s]", range=ends),
        "yaxis": axis(f"torque [{unit}]", range=[-top, top], nticks=7, zeroline=True, zerolinecolor=GREY),
        "barmode": "overlay",
        "uniformtext": {"mode": "hide", "minsize": 10},
    }
    return Plot(signs.joints[j], data, layout, PANEL_HEIGHT + MARGIN_HEIGHT, wide=True)


def _shades(signs: Signs, part: int, joint: int, top: float) -> list[dict[str, Any]]:
    """Segments of each sign, and uncertain ones, as bars of full height."""
    t, shades = signs.traces[part].t, {kind: list[SignSegment]() for kind, _, _ in SHADES}
    for segment in signs.of(joint):
        if segment.part == part:
            shades[_mark(segment) if segment.confidence >= CERTAINTY else "?"].append(segment)
    wide = float(np.median(np.diff(t))) if len(t) > 1 else 1.0  # minimum width, for segments of a single sample
    origin = signs.traces[part].origin
    bars = []
    for kind, name, colour in SHADES:
        segments = shades[kind]
        times = [(segment.start - origin, segment.end - origin) for segment in segments]
        shown = [
            [_mark(segment), f"{start:.6g}", f"{end:.6g}", confidence(segment.confidence)]
            for segment, (start, end) in zip(segments, times, strict=True)
        ]
        bar = {
            "type": "bar",
            "x": [(segment.start + segment.end) / 2 - origin for segment in segments],
            "width": [segment.end - segment.start + wide for segment in segments],
            "y": [2 * top] * len(segments),
            "base": -top,
            "marker": {"color": colour, "opacity": 0.3 if colour == YELLOW else 0.2, "line": {"width": 0}},
            "text": [plot_markup("$mark<br>$sure", mark=mark, sure=sure) for mark, _, _, sure in shown],
            "textposition": "inside",
            "insidetextanchor": "end",
            "textangle": 0,
            "textfont": {"color": INK, "size": 11},
            "customdata": shown,
            "hovertemplate": plot_markup(HOVER),
            "name": name,
        }
        bars.append(bar)
    return bars


def _mark(segment: SignSegment) -> str:
    return "+" if segment.sign > 0 else "−"
