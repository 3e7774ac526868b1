"""Plots of roll-outs: position error of the simulation over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .frame import AFTER, BEFORE, Plot, axis, packed

if TYPE_CHECKING:
    from ....simulation.rollout import RollOut

MOST = 60  # maximum number of points per line


def rollout_plots(before: RollOut, after: RollOut) -> list[Plot]:
    """Plot the rms error over windows against the time since their start, per joint.

    Args:
        before: roll-out of the original simulation.
        after: roll-out of the extended simulation.
    """
    return error_plots([("before", before, BEFORE, "dot"), ("after", after, AFTER, "solid")])


def error_plots(rolled: Sequence[tuple[str, RollOut, str, str]]) -> list[Plot]:
    """Plot the rms error over windows of several models against the time since their start, per joint.

    Args:
        rolled: name, roll-out, colour and dash of each model; a plot shows the models that have its joint.
    """
    found: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for name, one, colour, dash in rolled:
        step = -(-len(one.t) // MOST)
        kept = np.arange(len(one.t) - 1, -1, -step)[::-1]
        for j, (joint, unit) in enumerate(zip(one.joints, one.unit, strict=True)):
            error = np.sqrt(np.mean(one.error[:, kept, j] ** 2, axis=0))
            hover = f"{name}: %{{y:.3g}} {unit} after %{{x:.3g}} s<extra></extra>"
            line = {"color": colour, "width": 2, "dash": dash}
            whole = {"type": "scatter", "mode": "lines", "name": name, "line": line, "hovertemplate": hover}
            y = packed(np.where(np.isfinite(error), error, np.nan))
            found.setdefault((joint, unit), []).append({**whole, "x": packed(one.t[kept]), "y": y})
    return [Plot(joint, data, _layout(unit), 210) for (joint, unit), data in found.items()]


def _layout(unit: str) -> dict[str, Any]:
    return {
        "xaxis": axis("time since the start [s]", rangemode="tozero", nticks=6),
        "yaxis": axis(f"rms error [{unit}]", rangemode="tozero", nticks=6),
    }
