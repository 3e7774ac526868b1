"""Heat maps: residual, joint by region of velocity, position, load and time; correlation of parameter errors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ....estimation.excitation import MIN_INFO, ExcitationVerdict
from ....estimation.fit_quality import Course
from ....types import Array
from ..layout import plot_markup
from ..sections import Plot
from .courses import clock
from .frame import BLUE, GREEN, axis, packed

REGIONS, MIN_REGION_ROWS = 10, 3  # regions per variable, and minimum number of rows per region
HEAT_COLOURS = [[0, "rgba(209,80,14,0)"], [1, "rgba(209,80,14,1)"]]
MIN_TIED_CORRELATION = 0.95  # absolute correlation from which parameters are listed
MAX_DRAWN_PARAMETERS = 160  # maximum number of correlated parameters drawn
CORRELATION_COLOURS = [[0, "rgba(209,112,14,1)"], [0.5, "rgba(128,128,128,0)"], [1, "rgba(47,127,193,1)"]]
REGION_HOVER = "%{customdata[0]}: %{customdata[1]} times what no model could predict<extra></extra>"
MAX_LABEL_LENGTH = 16  # maximum length of the label of a joint [characters]
ROW_HEIGHT, AXIS_HEIGHT = 26, 62  # height of a row, and of the axis below [pixels]


class Variable(NamedTuple):
    """A variable that torque may depend on, in regions per joint."""

    name: str
    title: str  # of the axis
    values: Array  # (M, n) [unit of each joint]
    edges: Array  # (n, REGIONS + 1) [unit of each joint]
    units: tuple[str, ...]  # n


def heat_maps(course: Course, over: Array, top: float) -> list[Plot]:
    """Plot ratios over: (M, n) [1], joint by region of state and time; the colour saturates at `top` [1]."""
    return [_map(course.joints, variable, over, top) for variable in _variables(course)]


def hottest(course: Course, over: Array) -> float:
    """Return the largest ratio in such maps of the ratios over: (M, n) [1], at least 3 [1]."""
    sizes = [_rms(over, variable) for variable in _variables(course)]
    return max(3.0, *(float(np.nanmax(size, initial=0.0)) for size in sizes))


def _variables(course: Course) -> Iterator[Variable]:
    length = ["m" if prismatic else "rad" for prismatic in course.prismatic]
    speed, load = np.abs(course.v).max(axis=0), course.torque - course.before
    most, share = np.nanmax(np.abs(load), axis=0, initial=0.0), np.linspace(-1, 1, REGIONS + 1)
    speeds = tuple(f"{x}/s" for x in length)
    yield Variable("velocity", "velocity [% of max]", course.v, np.outer(speed, share), speeds)
    low, high = course.q.min(axis=0), course.q.max(axis=0)
    edges = np.linspace(low, high, REGIONS + 1).T
    yield Variable("position", "q [% of range]", course.q, edges, tuple(length))
    yield Variable("load", "load [% of max]", load, np.outer(most, share), course.unit)
    t, n = clock(course.t, course.recording), len(course.joints)
    edges = np.tile(np.linspace(t[0], t[-1], REGIONS + 1), (n, 1))
    yield Variable("time", "time [s]", np.tile(t[:, None], (1, n)), edges, ("s",) * n)


def _rms(over: Array, variable: Variable) -> Array:
    """Rms of each region, (n, BINS) [1]; NaN if it has too few rows."""
    edges = variable.edges
    low, width = edges[:, 0], np.maximum((edges[:, -1] - edges[:, 0]) / REGIONS, 1e-300)
    place = np.clip(np.nan_to_num((variable.values - low) / width, nan=0.0), 0, REGIONS - 1).astype(int)
    table = np.full((over.shape[1], REGIONS), np.nan)
    for row, size, region in zip(table, over.T, place.T, strict=True):
        known = np.isfinite(size)
        rows = np.bincount(region[known], minlength=REGIONS)
        squares = np.bincount(region[known], size[known] ** 2, minlength=REGIONS)
        enough = rows >= MIN_REGION_ROWS
        row[enough] = np.sqrt(squares[enough] / rows[enough])
    return table


def _map(joints: Sequence[str], variable: Variable, over: Array, top: float) -> Plot:
    table, name, edges = _rms(over, variable), variable.name, variable.edges
    shares = {"velocity": (-100.0, 100.0), "position": (0.0, 100.0), "load": (-100.0, 100.0)}
    low, high = shares.get(name, (float(edges[0, 0]), float(edges[0, -1])))
    rows = [zip(pairwise(ends), sizes, strict=True) for ends, sizes in zip(edges, table, strict=True)]
    cells = [
        [[f"{joint}, {name} {a:.3g} to {b:.3g} {unit}", f"{value:.3g}"] for (a, b), value in row]
        for joint, row, unit in zip(joints, rows, variable.units, strict=True)
    ]
    data = {
        "type": "heatmap",
        "x": np.linspace(low, high, REGIONS + 1).tolist(),
        "y": list(joints),
        "z": packed(np.log10(np.maximum(table, 1.0))),
        "customdata": cells,
        "zmin": 0,
        "zmax": float(np.log10(top)),
        "colorscale": HEAT_COLOURS,
        "showscale": False,
        "xgap": 1,
        "ygap": 1,
        "hoverongaps": False,
        "hovertemplate": plot_markup(REGION_HOVER),
    }
    ticks = {"tickmode": "array", "tickvals": list(joints), "ticktext": short_names(joints)}
    names = axis("", autorange="reversed", showgrid=False, type="category", **ticks)
    layout = {"xaxis": axis(variable.title, showgrid=False), "yaxis": names}
    return Plot(name, [data], layout, ROW_HEIGHT * len(joints) + AXIS_HEIGHT)


def short_names(names: Sequence[str], most: int = MAX_LABEL_LENGTH) -> list[str]:
    """Names short enough for labels, all different: without common words, else without their middle, else numbered.

    >>> short_names(["left_hip_roll_actuator_joint", "left_knee_pitch_actuator_joint"])
    ['left_hip_roll', 'left_knee_pitch']
    """
    if all(len(name) <= most for name in names):
        return list(names)
    words = [name.split("_") for name in names]
    end = 0
    while len(names) > 1 and all(len(some) > end + 1 and some[-end - 1] == words[0][-end - 1] for some in words):
        end += 1
    short = ["_".join(some[: len(some) - end]) for some in words]
    half = (most - 1) // 2
    short = [name if len(name) <= most else f"{name[:half]}…{name[-half:]}" for name in short]
    return short if len(set(short)) == len(short) else [f"{k + 1} {name[: most - 4]}" for k, name in enumerate(short)]


def correlation_plot(covariance: Array) -> Plot:
    """Plot the correlations of base parameters, numbered from 1; covariance: (b, b) [units of base]."""
    found = _correlations(covariance)[:MAX_DRAWN_PARAMETERS, :MAX_DRAWN_PARAMETERS]
    number = list(range(1, len(found) + 1))
    data = {
        "type": "heatmap",
        "x": number,
        "y": number,
        "z": packed(found),
        "zmin": -1,
        "zmax": 1,
        "colorscale": CORRELATION_COLOURS,
        "colorbar": {"title": {"text": "correlation [1]", "side": "right"}, "thickness": 12, "outlinewidth": 0},
        "hovertemplate": plot_markup("%{x} and %{y}: correlation %{z:.3f}<extra></extra>"),
        "hoverongaps": False,
    }
    title, size = "number of the base parameter [1]", {"showgrid": False, "nticks": 12}
    layout = {"xaxis": axis(title, **size), "yaxis": axis(title, autorange="reversed", **size)}
    return Plot("Correlation of the parameter errors", [data], layout, 420)


def _correlations(covariance: Array) -> Array:
    """Correlation matrix, (b, b) [1]; NaN if a variance is unknown."""
    std = np.sqrt(np.diag(covariance))
    with np.errstate(all="ignore"):
        return np.asarray(np.where(np.isfinite(covariance), covariance / np.outer(std, std), np.nan))


def tied(covariance: Array) -> list[tuple[int, int, float]]:
    """List pairs of parameters with strongly correlated errors, the strongest first; covariance: (b, b) [any unit]."""
    found = np.triu(np.nan_to_num(_correlations(covariance)), 1)
    rows, columns = np.nonzero(np.abs(found) >= MIN_TIED_CORRELATION)
    pairs = [(int(i), int(k), float(found[i, k])) for i, k in zip(rows, columns, strict=True)]
    return sorted(pairs, key=lambda pair: -abs(pair[2]))


def excitation_plot(found: ExcitationVerdict) -> Plot:
    """Plot the share of information per direction, ascending, and the required share."""
    shares = np.maximum(found.shares, 1e-6)
    number = np.arange(1.0, len(shares) + 1)
    bars = {
        "type": "bar",
        "x": packed(number),
        "y": packed(100 * shares),
        "marker": {"color": BLUE},
        "hovertemplate": plot_markup("direction %{x}: %{y:.3g} %<extra></extra>"),
    }
    ends = [0.5, len(shares) + 0.5]
    line = {"type": "scatter", "mode": "lines", "x": ends, "y": [100 * MIN_INFO] * 2, "hoverinfo": "skip"}
    layout = {
        "xaxis": axis("direction, weakest first [1]"),
        "yaxis": axis("share of information [%]", type="log", tickformat="~g"),
    }
    dashed = {**line, "line": {"color": GREEN, "dash": "dash", "width": 2}}
    title = "Directions in parameter space: information relative to random motion; dashed: required"
    return Plot(title, [bars, dashed], layout, 260, wide=True)
