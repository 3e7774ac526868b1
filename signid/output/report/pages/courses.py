"""Held-out torque before and after: over time, and what is left of it against what it may depend on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ....estimation.fit_quality import Course, Fit
from ....types import Array, Indices
from ..numbers import determination, figure
from .frame import AFTER, BEFORE, FAINT, INK, Plot, axis, packed, thinned

POINTS, DOTS = 16_000, 9_000  # of all joints together
FEWEST = 150
BINS = 24
OPEN = 3  # joints that are shown at once
TOP, GAP = 0.42, 0.06  # share of a plot that the residual has, and between the two


class JointPlots(NamedTuple):
    """What is drawn of a joint."""

    name: str
    told: str
    open: bool
    plots: tuple[Plot, ...]


class Line(NamedTuple):
    """A line of a plot of torque over time."""

    name: str
    axis: str  # "y": torque, "y2": residual
    colour: str
    style: dict[str, Any]
    values: Array  # (M,) [N.m or N]


def joint_plots(course: Course, before: Fit, after: Fit, chosen: Sequence[int]) -> list[JointPlots]:
    """Torque over time and its residual against velocity, position and load, joint by joint.

    Args:
        course: what was held out.
        before: fit of the model before.
        after: fit of the model after.
        chosen: joints that are shown at once, if they are not too many.
    """
    shown, found = [*dict.fromkeys(chosen)][:OPEN], []
    for j, joint in enumerate(course.joints):
        rms = (float(fit.held_out_rms[j]) for fit in (before, after))
        told = " → ".join(map(figure, rms)) + f" {course.unit[j]}, R2 {determination(float(after.held_out_r2[j]))}"
        plots = tuple(_plots(course, j)) if np.isfinite(course.torque[:, j]).any() else ()
        found.append(JointPlots(joint, told, j in shown, plots))
    return found


def _plots(course: Course, j: int) -> Iterator[Plot]:
    unit, length = course.unit[j], "m" if course.prismatic[j] else "rad"
    yield _over_time(course, j, unit)
    variables: tuple[tuple[str, Array], ...] = (
        (f"velocity [{length}/s]", course.v[:, j]),
        (f"position [{length}]", course.q[:, j]),
        (f"load: predicted torque [{unit}]", course.torque[:, j] - course.before[:, j]),
    )
    for title, x in variables:
        yield _against(course, j, title, x, unit)


def _over_time(course: Course, j: int, unit: str) -> Plot:
    measured, left = course.torque[:, j], (course.before[:, j], course.after[:, j])
    lines = (
        Line("measured", "y", INK, {"width": 1.6}, measured),
        Line("predicted before", "y", BEFORE, {"width": 1.4, "dash": "dot"}, measured - left[0]),
        Line("predicted after", "y", AFTER, {"width": 1.4}, measured - left[1]),
        Line("residual before", "y2", BEFORE, {"width": 1.2, "dash": "dot"}, left[0]),
        Line("residual after", "y2", AFTER, {"width": 1.2}, left[1]),
    )
    most = max(FEWEST, POINTS // len(course.joints))
    return torque_plot(course.joints[j], clock(course.t, course.recording), course.stretch, unit, lines, most)


def torque_plot(joint: str, t: Array, stretch: Indices, unit: str, lines: Sequence[Line], most: int) -> Plot:
    """Torque over time above, residuals below.

    Args:
        joint: its name.
        t: (M,) [s].
        stretch: (M,) number of the stretch without gaps.
        unit: of torque.
        lines: to be drawn, each over the same time.
        most: points a line.
    """
    first = np.flatnonzero(np.diff(stretch, prepend=stretch[:1] - 1))
    t, values = thinned(t, np.column_stack([line.values for line in lines]), first, most)
    data = [
        {
            "type": "scatter",
            "mode": "lines",
            "name": line.name,
            "x": packed(t),
            "y": packed(y),
            "yaxis": line.axis,
            "line": {"color": line.colour, **line.style},
            "hovertemplate": f"{line.name}: %{{y:.4g}} {unit} at %{{x:.5g}} s<extra></extra>",
        }
        for line, y in zip(lines, values.T, strict=True)
    ]
    layout = {
        "xaxis": axis("time [s]", anchor="y2"),
        "yaxis": axis(f"torque [{unit}]", domain=[TOP + GAP, 1], nticks=6),
        "yaxis2": axis(f"residual [{unit}]", domain=[0, TOP - GAP], nticks=5, zeroline=True, zerolinecolor=FAINT),
    }
    return Plot(f"{joint}: torque over time, and measured - predicted", data, layout, 360, wide=True)


def _against(course: Course, j: int, title: str, x: Array, unit: str) -> Plot:
    """Residual before and after, each row a dot, and the mean over stretches of x."""
    step = -(-len(course) * len(course.joints) * 6 // DOTS)
    data = []
    for name, left, colour in (("before", course.before[:, j], BEFORE), ("after", course.after[:, j], AFTER)):
        told = np.isfinite(left) & np.isfinite(x)
        dots = {"type": "scatter", "mode": "markers", "hoverinfo": "skip", "marker": {"color": colour, "size": 3}}
        data.append({**dots, "opacity": 0.35, "x": packed(x[told][::step]), "y": packed(left[told][::step])})
        middle, mean = _means(x[told], left[told])
        hover = f"mean {name}: %{{y:.3g}} {unit} at %{{x:.3g}}<extra></extra>"
        line = {"color": colour, "width": 2.4, **({"dash": "dot"} if name == "before" else {})}
        means = {"type": "scatter", "mode": "lines", "line": line, "hovertemplate": hover, "name": name}
        data.append({**means, "x": packed(middle), "y": packed(mean)})
    layout = {"xaxis": axis(title, nticks=6), "yaxis": axis(f"residual [{unit}]", zeroline=True, zerolinecolor=FAINT)}
    return Plot(f"against {title.partition(' [')[0].partition(':')[0]}", data, layout)


def _means(x: Array, y: Array) -> tuple[Array, Array]:
    """Mean of x and of y over stretches of x that hold equally many rows."""
    if not len(x):
        return x, y
    order = np.argsort(x, kind="stable")
    parts = np.array_split(order, min(BINS, max(1, len(x) // 5)))
    return np.array([x[part].mean() for part in parts]), np.array([y[part].mean() for part in parts])


def clock(t: Array, recording: Indices) -> Array:
    """(M,) time of rows [s]; recordings one after the other where there are several.

    Args:
        t: (M,) [s].
        recording: (M,) number of the recording.
    """
    if not len(t) or recording[0] == recording[-1]:
        return np.asarray(t)
    parts = np.split(t, np.flatnonzero(np.diff(recording)) + 1)
    starts = np.cumsum([0.0, *(float(part[-1] - part[0]) for part in parts[:-1])])
    return np.concatenate([part - part[0] + start for part, start in zip(parts, starts, strict=True)])


def worst(before: Fit, size: Callable[[Array], Array] = np.asarray) -> list[int]:
    """Joints by how far their held-out residual was above the noise floor, the farthest first."""
    over = np.nan_to_num(before.held_out_rms / np.maximum(before.irreducible_rms, 1e-300), posinf=0.0)
    return [int(j) for j in np.argsort(-size(over), kind="stable")]
