"""Page of a check: the description on the terminal in full, with recordings over time and their spectra.

Recordings that cannot be checked have no other description than the reason and what to correct.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import RenderableType

from ....faults import UnusableRecordings
from ....types import Array, Input, Recording, Samples
from ....version import __version__
from ..documents import Document, ending, once
from ..layout import figure, plot_markup, plural
from ..pages import BLUE, GREEN, GREY, ORANGE, Header, axis, curve, packed, sections_page
from ..plots import MAX_OPEN, MIN_POINTS, Line, Panes, line_points, recorded_lines
from ..sections import INK, Card, Cells, Folds, JointPlots, Key, Legend, Plain, Plot, Section, Sentences
from .check_summary import (
    SAMPLING_HEADS,
    UNUSABLE,
    CheckSummary,
    FaultWords,
    GravityUse,
    Identifiable,
    first_part,
    summary_document,
    summary_tables,
    unit_sentences,
)

MAX_DRAWN_RECORDINGS = 4  # maximum number of recordings that are drawn
MAX_SPECTRUM_ROWS, WINDOW_ROWS = 65_536, 2048  # most rows of a spectrum, and rows of one window
MAX_BINS = 150  # points of a spectrum
MIN_VISIBLE_SHARE = 0.002  # [1] smallest width of omitted rows, over the duration
MIN_POWER = 1e-12  # [1] smallest power density that is drawn, over the largest
CHECK_KEY = (
    ("measured", "position"),
    ("floor", "command"),
    ("after", "torque, or command - position"),
    ("omitted", "omitted: gaps, and rows that cannot be used"),
)
OMITTED_COLOUR = "rgba(209, 112, 14, 0.16)"
Stretches = Sequence[tuple[float, float]]  # start and end [s] of what is used of a recording
Marks = Mapping[str, float]  # frequencies [Hz] that are marked in the spectra of one joint


class _Drawn(NamedTuple):
    """A recording that is drawn."""

    recording: Recording
    stretches: Stretches  # that are used
    t: Array  # (M,) [s]
    lines: Array  # (M, 3 n) positions, torques and commands [rad or m, N.m or N]


class _Course(NamedTuple):
    """Recordings in sequence: position, torque and command of one joint over time, NaN between recordings."""

    t: Array  # (M,) [s]
    lines: Array  # (M, 3) [rad or m, N.m or N]
    omitted: list[tuple[float, float]]  # [s]


def summary_page(
    summary: CheckSummary, joints: Sequence[JointPlots], verdicts: Cells, files: Sequence[Input], **given: Any
) -> str:
    """Page of a check; `verdicts`: what is identifiable; `given`: the command and the seed."""
    several = len(summary.sampling.rows)
    order = " The first recordings only, one after another." if several > MAX_DRAWN_RECORDINGS else ""
    order = order or (" Recordings one after another." if several > 1 else "")
    clear = f"Looked for, and not found: {', '.join(summary.clear)}." if summary.clear else ""
    faults = Sentences([fault.sentence for fault in summary.faults]) if summary.faults else Plain("No fault was found.")
    sections = [
        Section("Sampling and clock", (summary.sampling, Sentences(summary.sampled))),
        Section("Units and columns", (Sentences([*unit_sentences(summary.units), *summary.unit_notes]),)),
        Section("Gravity", (Plain(summary.gravity.sentence),)),
        Section("Faults of the log", (faults, Legend(clear))),
        Section("Joints", (summary.joints, Legend(f"{summary.legend}.")) if summary.joints.rows else ()),
        Section(
            "Recordings over time, and their spectra",
            (Key(CHECK_KEY), Folds(f"Spectra of the longest stretch.{order}", joints)) if joints else (),
        ),
        Section("What to record next", (Sentences(summary.advice),)),
        Section(summary.identifiable.counts, (Plain(summary.excitation), verdicts)),
    ]
    which, gravity = summary.identifiable, summary.gravity.verdict
    others = f"{which.noun}s; {len(which.weak)} weak, {len(which.unidentifiable)} not"
    cards = [Card("identifiable", f"{len(which.identifiable)} of {which.total}", others)]
    rates = [(float(row[5]), float(row[4])) for row in summary.sampling.rows if row[5] != "-" and row[4] != "-"]
    if rates:
        content, rate = min(rates)
        lowest = f"lowest of {len(rates)} recordings; " if len(rates) > 1 else ""
        cards.append(Card("content", f"{content:g} Hz", f"{lowest}rows at {rate:g} Hz"))
    cards.append(Card("faults", str(len(summary.faults)), "of the log"))
    cards.append(Card("gravity", gravity, "with the stated one" if gravity == "agrees" else ""))
    kind = {"good": "nothing_missing", "limited": "unknown"}.get(summary.verdict, "unreliable")
    header = Header(summary.title, f"check of {summary.title}", cards, kind, summary.headline)
    shared = {"flags": (), "notes": summary.notes, "files": files, "version": __version__, **given}
    return sections_page(header, sections, shared)


def _unusable(found: UnusableRecordings, robot: str) -> CheckSummary:
    given, remedy = plural(len(found.files), "recording"), found.flags[0].partition("; ")[2]
    rows = [(Path(file.path).name, str(count), *"------") for file, count in zip(found.files, found.rows, strict=True)]
    return CheckSummary(
        title=f"{robot}: {given}" if robot else given,
        verdict=UNUSABLE,
        headline=f"Not usable for identification: {first_part(found.flags[0])}",
        sampling=Cells(SAMPLING_HEADS, rows),
        gravity=GravityUse("not judged", "not judged: the recordings cannot be used as they are"),
        faults=tuple(FaultWords("", (), flag) for flag in found.flags),
        identifiable=Identifiable("parameter", (), (), ()),
        advice=(remedy,) if remedy else (),
    )


def unusable_document(found: UnusableRecordings, inputs: Sequence[Input], seed: int = 0, robot: str = "") -> Document:
    """Build check.json of recordings that cannot be checked; `robot`: its name, "" without a description."""
    files = zip(found.files, found.rows, strict=True)
    return {
        "schema": "signid.check/1",
        "robot": robot or None,
        **summary_document(_unusable(found, robot)),
        "recordings": [{"path": file.path, "rows": rows} for file, rows in files],
        **ending(found, found.files, inputs, seed),
    }


def unusable_tables(found: UnusableRecordings, robot: str = "") -> list[RenderableType]:
    """The reason, and what to correct, on one screen; `robot` as in the document."""
    return summary_tables(_unusable(found, robot))


def unusable_page(
    found: UnusableRecordings, inputs: Sequence[Input] = (), command: str = "", seed: int = 0, robot: str = ""
) -> str:
    """Render report.html of recordings that cannot be checked; `robot` as in the document."""
    summary, files = _unusable(found, robot), once([*found.files, *inputs])
    return summary_page(summary, [], Cells((), ()), files, command=command, seed=seed)


def recording_files(recordings: Sequence[Recording]) -> list[Input]:
    """Recordings as input files."""
    return [Input(recording.path, recording.sha256, "recording") for recording in recordings]


def used_times(recording: Recording, spans: Sequence[tuple[int, int]]) -> list[tuple[float, float]]:
    """Start and end [s] of spans of rows."""
    column = recording.columns["t"]
    ends = ((start, stop - 1) for start, stop in spans)
    return [tuple(float(recording.table.read(column, k, k + 1)[0, 0]) for k in pair) for pair in ends]  # type: ignore[misc]


def recorded_plots(
    recordings: Sequence[Recording],
    used: Sequence[Stretches],
    joints: Sequence[str],
    units: Sequence[tuple[str, str]],
    marks: Sequence[Marks],
    summary: CheckSummary,
) -> Iterator[JointPlots]:
    """Plots per joint; joints with a fault are unfolded first."""
    if not joints:
        return
    faulty = {joint: fault.kind or "fault" for fault in summary.faults for joint in fault.joints}
    shown = sorted(joints, key=lambda joint: joint not in faulty)[:MAX_OPEN]
    most = line_points(len(joints) * min(len(recordings), MAX_DRAWN_RECORDINGS))
    drawn = [
        _Drawn(recording, stretches, *recorded_lines(recording, most))
        for recording, stretches in zip(recordings[:MAX_DRAWN_RECORDINGS], used, strict=False)
    ]
    longest = max(drawn, key=lambda part: max((b - a for a, b in part.stretches), default=0.0))
    if not longest.stretches:
        rows = None
    else:
        start, end = max(longest.stretches, key=lambda pair: pair[1] - pair[0])
        t = longest.recording.table.read(longest.recording.columns["t"], 0, len(longest.recording))[:, 0]
        first = int(np.argmax(t >= start))
        stop = min(first + MAX_SPECTRUM_ROWS, len(t) - int(np.argmax(t[::-1] <= end)))
        rows = longest.recording.read(first, stop, servo=False)
    for joint, unit, frequencies in zip(joints, units, marks, strict=True):
        having = [part for part in drawn if joint in part.recording.joints]
        if not having:
            continue
        plots = [_over_time(joint, _sequence(having, joint), *unit)]
        if rows is not None and joint in longest.recording.joints:
            plots += _spectra(rows, longest.recording.joints.index(joint), *unit, frequencies)
        row = next(row for row in summary.joints.rows if row[0] == joint)
        words = f"range {row[1]} {unit[0]}" + (f"; {faulty[joint]}" if joint in faulty else "")
        yield JointPlots(joint, words, joint in shown, tuple(plots))


def _sequence(drawn: Sequence[_Drawn], joint: str) -> _Course:
    """Lines of one joint of recordings, one after another, with the rows that are omitted."""
    times, lines, omitted, now = [], [], list[tuple[float, float]](), 0.0
    for part in drawn:
        j, n = part.recording.joints.index(joint), len(part.recording.joints)
        known = np.isfinite(part.t)
        t, values = part.t[known], part.lines[known][:, [j, n + j, 2 * n + j]]
        first, last = float(t[0]), float(t[-1])
        edges = [first, *(x for pair in part.stretches for x in pair), last]
        gaps = [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b > a]
        breaks = [int(np.searchsorted(t, b)) for a, b in gaps if not np.any((t > a) & (t < b))]
        t, values = np.insert(t, breaks, np.nan), np.insert(values, breaks, np.nan, axis=0)
        wide = MIN_VISIBLE_SHARE * (last - first) / 2
        omitted += [(a - first + now - wide, b - first + now + wide) for a, b in gaps]
        times += [t - first + now, np.array([np.nan])]
        lines += [values, np.full((1, 3), np.nan)]
        now += last - first
    return _Course(np.concatenate(times), np.concatenate(lines), omitted)


def _over_time(joint: str, course: _Course, length: str, torque: str) -> Plot:
    """Plot position, command, and torque or tracking error; omitted rows are shaded."""
    q, tau, command = course.lines.T
    is_torque = bool(torque and np.isfinite(tau).any())
    name, below = ("torque", tau) if is_torque else ("command - position", command - q)
    dashed = {"width": 1.2, "dash": "dash"}
    lines = [Line("command", "y", GREEN, dashed, command)] if np.isfinite(command).any() else []
    lines += [Line("position", "y", INK, {"width": 1.6}, q)]
    lines += [Line(name, "y2", BLUE, {"width": 1.3}, below)] if np.isfinite(below).any() else []
    panes = Panes("position", "torque" if is_torque else "error", (length, torque if is_torque else length), 0.5, 320)
    plot = panes.plot(f"{joint}: position and {name} over time", course.t, lines)
    whole = {"type": "rect", "xref": "x", "yref": "paper", "y0": 0, "y1": 1, "fillcolor": OMITTED_COLOUR}
    shapes = [{**whole, "x0": a, "x1": b, "line": {"width": 0}} for a, b in course.omitted]
    return plot._replace(layout={**plot.layout, "shapes": shapes})


def _spectra(rows: Samples, j: int, length: str, torque: str, marks: Marks) -> Iterator[Plot]:
    """Plot the power density of position and torque, or command, of one joint, with marked frequencies [Hz]."""
    from scipy.signal import welch

    signals = [("position", rows.q[:, j], length)]
    if torque and np.isfinite(rows.tau[:, j]).any():
        signals.append(("torque", rows.tau[:, j], f"({torque})"))
    elif rows.q_des is not None:
        signals.append(("command", rows.q_des[:, j], length))
    for name, values, unit in signals:
        known = np.isfinite(values) & np.isfinite(rows.t)
        if known.sum() <= MIN_POINTS:
            continue
        t = rows.t[known]
        period = float(np.median(np.diff(t)))
        grid = np.arange(t[0], t[-1], period)
        f, power = welch(np.interp(grid, t, values[known]), 1 / period, nperseg=min(WINDOW_ROWS, len(grid)))
        power = np.maximum(power[1:], MIN_POWER * max(float(power.max()), 1e-300))
        edges = np.unique(np.geomspace(1, len(power), MAX_BINS).astype(int)) - 1  # the axis is logarithmic; peaks stay
        shown = packed(f[1:][edges]), packed(np.maximum.reduceat(power, edges))
        data: list[dict[str, Any]] = [curve(name, *shown, {"color": INK, "width": 1.3}, hoverinfo="skip")]
        ends = [float(power.min()), float(power.max())]
        for (mark, place), colour in zip(marks.items(), (ORANGE, BLUE, GREY)[-len(marks) :], strict=True):
            if f[1] <= place <= f[-1]:
                hover = plot_markup("$mark: %{x:.4g} Hz<extra></extra>", mark=mark)
                line = {"color": colour, "width": 2, "dash": "dash"}
                data.append(curve(mark, [place, place], ends, line, hovertemplate=hover))
        named = ", ".join(f"{mark} {figure(place)} Hz" for mark, place in marks.items() if np.isfinite(place))
        layout = {
            "xaxis": axis("frequency [Hz]", type="log", dtick=1),
            "yaxis": axis(f"density [{unit}²/Hz]", type="log", nticks=5, exponentformat="e"),
        }
        yield Plot(f"spectrum of the {name}; dashed: {named}", data, layout)
