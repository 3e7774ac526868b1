"""Heat maps of the residual: joint by region of velocity, position, load and time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .courses import clock
from .frame import Plot, axis, packed

if TYPE_CHECKING:
    from ....estimation.fit_quality import Course
    from ....types import Array

BINS, FEWEST = 10, 3  # regions per variable, and minimum number of rows per region
HOT = [[0, "rgba(209,80,14,0)"], [1, "rgba(209,80,14,1)"]]
ROW, ROOM = 26, 62  # height of a row, and of the axis below [pixels]


class Variable(NamedTuple):
    """A variable that torque may depend on, in regions per joint."""

    name: str
    title: str  # of the axis
    values: Array  # (M, n) [unit of each joint]
    edges: Array  # (n, BINS + 1) [unit of each joint]
    units: tuple[str, ...]  # n


def heat_maps(course: Course, left: Array, floor: Array, top: float) -> list[Plot]:
    """Plot the rms residual over what no model could predict, joint by region of its state and time.

    Args:
        course: rows.
        left: (M, n) residual [N.m or N].
        floor: (n,) rms of what no model could predict [N.m or N].
        top: ratio at which the colour saturates [1].
    """
    return [_map(course.joints, variable, left / floor, top) for variable in _variables(course)]


def hottest(course: Course, left: Array, floor: Array) -> float:
    """Return the largest ratio of residual to that floor of such a map, at least 3 [1].

    Args:
        course: rows.
        left: (M, n) residual [N.m or N].
        floor: (n,) rms of what no model could predict [N.m or N].
    """
    sizes = [_rms(left / floor, variable) for variable in _variables(course)]
    return max(3.0, *(float(np.nanmax(size, initial=0.0)) for size in sizes))


def _variables(course: Course) -> Iterator[Variable]:
    length = ["m" if prismatic else "rad" for prismatic in course.prismatic]
    speed, load = np.abs(course.v).max(axis=0), course.torque - course.before
    most, share = np.nanmax(np.abs(load), axis=0, initial=0.0), np.linspace(-1, 1, BINS + 1)
    speeds = tuple(f"{x}/s" for x in length)
    yield Variable("velocity", "velocity [% of max]", course.v, np.outer(speed, share), speeds)
    low, high = course.q.min(axis=0), course.q.max(axis=0)
    edges = np.linspace(low, high, BINS + 1).T
    yield Variable("position", "position [% of range]", course.q, edges, tuple(length))
    yield Variable("load", "load [% of max]", load, np.outer(most, share), course.unit)
    t, n = clock(course.t, course.recording), len(course.joints)
    edges = np.tile(np.linspace(t[0], t[-1], BINS + 1), (n, 1))
    yield Variable("time", "time [s]", np.tile(t[:, None], (1, n)), edges, ("s",) * n)


def _rms(over: Array, variable: Variable) -> Array:
    """Rms of each region, (n, BINS) [1]; NaN if it has too few rows."""
    edges = variable.edges
    low, width = edges[:, 0], np.maximum((edges[:, -1] - edges[:, 0]) / BINS, 1e-300)
    place = np.clip(np.nan_to_num((variable.values - low) / width, nan=0.0), 0, BINS - 1).astype(int)
    table = np.full((over.shape[1], BINS), np.nan)
    for j, (size, region) in enumerate(zip(over.T, place.T, strict=True)):
        known = np.isfinite(size)
        rows = np.bincount(region[known], minlength=BINS)
        squares = np.bincount(region[known], size[known] ** 2, minlength=BINS)
        table[j, rows >= FEWEST] = np.sqrt(squares[rows >= FEWEST] / rows[rows >= FEWEST])
    return table


def _map(joints: Sequence[str], variable: Variable, over: Array, top: float) -> Plot:
    table, name, edges = _rms(over, variable), variable.name, variable.edges
    ends: tuple[float, float] = {"velocity": (-100, 100), "position": (0, 100), "load": (-100, 100)}.get(
        name, (float(edges[0, 0]), float(edges[0, -1]))
    )
    regions = [
        [f"{joint}, {name} {a:.3g} to {b:.3g} {unit}" for a, b in zip(row[:-1], row[1:], strict=True)]
        for joint, row, unit in zip(joints, edges, variable.units, strict=True)
    ]
    data = {
        "type": "heatmap",
        "x": np.linspace(*ends, BINS + 1).tolist(),
        "y": list(joints),
        "z": packed(np.log10(np.maximum(table, 1.0))),
        "customdata": [
            [[text, f"{value:.3g}"] for text, value in zip(*row, strict=True)]
            for row in zip(regions, table, strict=True)
        ],
        "zmin": 0,
        "zmax": float(np.log10(top)),
        "colorscale": HOT,
        "showscale": False,
        "xgap": 1,
        "ygap": 1,
        "hoverongaps": False,
        "hovertemplate": "%{customdata[0]}: %{customdata[1]} times what no model could predict<extra></extra>",
    }
    rows = axis("", autorange="reversed", showgrid=False, type="category")
    layout = {"xaxis": axis(variable.title, showgrid=False), "yaxis": rows}
    return Plot(name, [data], layout, ROW * len(joints) + ROOM)
