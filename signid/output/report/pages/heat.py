"""Where the mismatch sits: joint by region of what torque may depend on."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from .courses import clock
from .frame import Plot, axis, packed

if TYPE_CHECKING:
    from ....estimation.fit_quality import Course
    from ....types import Array

BINS, FEWEST = 10, 3  # regions of a variable, and rows that one must hold
HOT = [[0, "rgba(209,80,14,0)"], [1, "rgba(209,80,14,1)"]]
ROW, ROOM = 26, 62  # [pixels]


def heat_maps(course: Course, left: Array, floor: Array, top: float) -> list[Plot]:
    """The rms residual over the noise floor, joint by region of velocity, position, load (predicted torque) and time.

    Args:
        course: rows.
        left: (M, n) residual [N.m or N].
        floor: (n,) noise floor [N.m or N].
        top: from where on the colour stays the same [1].
    """
    return [_map(course, left / floor, *variable, top) for variable in _variables(course)]


def hottest(course: Course, left: Array, floor: Array) -> float:
    """The largest number of such a map, at least 3 [1].

    Args:
        course: rows.
        left: (M, n) residual [N.m or N].
        floor: (n,) noise floor [N.m or N].
    """
    sizes = [_rms(left / floor, *_places(x, edges)) for _, _, x, edges, _ in _variables(course)]
    return max(3.0, *(float(np.nanmax(size, initial=0.0)) for size in sizes))


def _variables(course: Course) -> Iterator[tuple[str, str, Array, Array, tuple[str, ...]]]:
    """Name, title of the axis, values (M, n), edges (n, BINS + 1), unit of each joint."""
    length = ["m" if prismatic else "rad" for prismatic in course.prismatic]
    speed, load = np.abs(course.v).max(axis=0), course.torque - course.before
    most, share = np.nanmax(np.abs(load), axis=0, initial=0.0), np.linspace(-1, 1, BINS + 1)
    yield "velocity", "velocity [% of max]", course.v, np.outer(speed, share), tuple(f"{x}/s" for x in length)
    low, high = course.q.min(axis=0), course.q.max(axis=0)
    yield "position", "position [% of range]", course.q, np.linspace(low, high, BINS + 1).T, tuple(length)
    yield "load", "load [% of max]", load, np.outer(most, share), course.unit
    t = clock(course.t, course.recording)
    edges = np.tile(np.linspace(t[0], t[-1], BINS + 1), (len(course.joints), 1))
    yield "time", "time [s]", np.tile(t[:, None], (1, len(course.joints))), edges, ("s",) * len(course.joints)


def _places(x: Array, edges: Array) -> tuple[Array, int]:
    """(M, n) number of the region that each row is in, and how many there are."""
    low, width = edges[:, 0], np.maximum((edges[:, -1] - edges[:, 0]) / BINS, 1e-300)
    return np.clip(np.nan_to_num((x - low) / width, nan=0.0), 0, BINS - 1).astype(int), BINS


def _rms(over: Array, place: Array, count: int) -> Array:
    """(n, count) rms of each region; NaN where there are too few rows."""
    table = np.full((over.shape[1], count), np.nan)
    for j, (size, region) in enumerate(zip(over.T, place.T, strict=True)):
        told = np.isfinite(size)
        rows = np.bincount(region[told], minlength=count)
        squares = np.bincount(region[told], size[told] ** 2, minlength=count)
        table[j, rows >= FEWEST] = np.sqrt(squares[rows >= FEWEST] / rows[rows >= FEWEST])
    return table


def _map(
    course: Course, over: Array, name: str, title: str, x: Array, edges: Array, units: tuple[str, ...], top: float
) -> Plot:
    table = _rms(over, *_places(x, edges))
    ends: tuple[float, float] = {"velocity": (-100, 100), "position": (0, 100), "load": (-100, 100)}.get(
        name, (float(edges[0, 0]), float(edges[0, -1]))
    )
    told = [
        [f"{joint}, {name} {a:.3g} to {b:.3g} {unit}" for a, b in zip(row[:-1], row[1:], strict=True)]
        for joint, row, unit in zip(course.joints, edges, units, strict=True)
    ]
    data = {
        "type": "heatmap",
        "x": np.linspace(*ends, BINS + 1).tolist(),
        "y": list(course.joints),
        "z": packed(np.log10(np.maximum(table, 1.0))),
        "customdata": [
            [[text, f"{value:.3g}"] for text, value in zip(*row, strict=True)] for row in zip(told, table, strict=True)
        ],
        "zmin": 0,
        "zmax": float(np.log10(top)),
        "colorscale": HOT,
        "showscale": False,
        "xgap": 1,
        "ygap": 1,
        "hoverongaps": False,
        "hovertemplate": "%{customdata[0]}: %{customdata[1]} times the noise floor<extra></extra>",
    }
    rows = axis("", autorange="reversed", showgrid=False, type="category")
    layout = {"xaxis": axis(title, showgrid=False), "yaxis": rows}
    return Plot(name, [data], layout, ROW * len(course.joints) + ROOM)
