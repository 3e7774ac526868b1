"""Correlation of parameter errors."""

from __future__ import annotations

import numpy as np

from ....types import Array
from .frame import Plot, axis, packed

MOST = 160  # maximum number of parameters drawn
SCALE = [[0, "rgba(209,112,14,1)"], [0.5, "rgba(128,128,128,0)"], [1, "rgba(47,127,193,1)"]]


def correlation_plot(covariance: Array) -> Plot:
    """Plot the correlations of base parameters, numbered from 1 in the order of their table.

    Args:
        covariance: (b, b) [units of base].
    """
    kept = min(len(covariance), MOST)
    found = correlations(covariance)[:kept, :kept]
    number = list(range(1, kept + 1))
    data = {
        "type": "heatmap",
        "x": number,
        "y": number,
        "z": packed(found),
        "zmin": -1,
        "zmax": 1,
        "colorscale": SCALE,
        "colorbar": {"title": {"text": "correlation [1]", "side": "right"}, "thickness": 12, "outlinewidth": 0},
        "hovertemplate": "%{x} and %{y}: correlation %{z:.3f}<extra></extra>",
        "hoverongaps": False,
    }
    size = {"showgrid": False, "nticks": 12}
    layout = {
        "xaxis": axis("number of the base parameter [1]", **size),
        "yaxis": axis("number of the base parameter [1]", autorange="reversed", **size),
    }
    return Plot("Correlation of the parameter errors", [data], layout, 420)


def correlations(covariance: Array) -> Array:
    """Correlation matrix, (b, b) [1]; NaN if a variance is unknown.

    Args:
        covariance: (b, b) [units of base].
    """
    std = np.sqrt(np.diag(covariance))
    with np.errstate(all="ignore"):
        return np.asarray(np.where(np.isfinite(covariance), covariance / np.outer(std, std), np.nan))


def tied(covariance: Array, least: float = 0.95) -> list[tuple[int, int, float]]:
    """List pairs of parameters with strongly correlated errors, the strongest first.

    Args:
        covariance: (b, b) [units of base].
        least: minimum absolute correlation.
    """
    found = np.triu(np.nan_to_num(correlations(covariance)), 1)
    rows, columns = np.nonzero(np.abs(found) >= least)
    pairs = [(int(i), int(k), float(found[i, k])) for i, k in zip(rows, columns, strict=True)]
    return sorted(pairs, key=lambda pair: -abs(pair[2]))
