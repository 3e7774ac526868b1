"""Roll-outs before and after: how far the simulation strays from measured positions as time passes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .frame import AFTER, BEFORE, Plot, axis, packed

if TYPE_CHECKING:
    from ...rollout import RollOut

MOST = 60  # instants


def rollout_plots(before: RollOut, after: RollOut) -> list[Plot]:
    """Rms error over windows against the time since their start, joint by joint.

    Args:
        before: of the simulation as it was.
        after: of the simulation with what it lacked.
    """
    step = -(-len(before.t) // MOST)
    kept = np.arange(len(before.t) - 1, -1, -step)[::-1]
    plots = []
    for j, (joint, unit) in enumerate(zip(before.joints, before.unit, strict=True)):
        data = []
        for name, found, colour, dash in (("before", before, BEFORE, "dot"), ("after", after, AFTER, "solid")):
            error = np.sqrt(np.mean(found.error[:, kept, j] ** 2, axis=0))
            hover = f"{name}: %{{y:.3g}} {unit} after %{{x:.3g}} s<extra></extra>"
            line = {"color": colour, "width": 2, "dash": dash}
            whole = {"type": "scatter", "mode": "lines", "name": name, "line": line, "hovertemplate": hover}
            y = packed(np.where(np.isfinite(error), error, np.nan))
            data.append({**whole, "x": packed(found.t[kept]), "y": y})
        layout = {
            "xaxis": axis("time since the start [s]", rangemode="tozero", nticks=6),
            "yaxis": axis(f"rms error [{unit}]", rangemode="tozero", nticks=6),
        }
        plots.append(Plot(joint, data, layout, 210))
    return plots
