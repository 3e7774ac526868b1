"""Roll-outs before and after: how far the simulation strays from measured positions as time passes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .frame import AFTER, BEFORE, Plot, axis, packed

if TYPE_CHECKING:
    from ....simulation.rollout import RollOut

MOST = 60  # instants


def rollout_plots(before: RollOut, after: RollOut) -> list[Plot]:
    """Rms error over windows against the time since their start, joint by joint.

    Args:
        before: of the simulation as it was.
        after: of the simulation with what it lacked.
    """
    return error_plots([("before", before, BEFORE, "dot"), ("after", after, AFTER, "solid")])


def error_plots(rolled: Sequence[tuple[str, RollOut, str, str]]) -> list[Plot]:
    """Rms error over windows of several models against the time since their start, a plot for each joint.

    Args:
        rolled: name, roll-out, colour and dash of each model; a joint's plot has the models that move it.
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
