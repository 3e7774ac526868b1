"""Where a mismatch is: the variable whose bins explain most of its variance, and its third with the largest rms."""

from __future__ import annotations

import numpy as np

from ...types import Array
from .closed_loop import ClosedLoop

BINS = 9
THIRDS = ("lowest", "middle", "highest")


def depends_on(loop: ClosedLoop, residual: Array, joint: int) -> str:
    """Name of the variable; residual: (W, T, n) [rad or m]."""
    y = residual[:, :, joint].ravel()
    variables = _variables(loop, joint)
    return max(variables, key=lambda name: _explained(variables[name], y))


def worst_region(loop: ClosedLoop, residual: Array, joint: int, variable: str) -> tuple[str, float]:
    """Third of the values of a variable with the largest mismatch, and the rms there [rad or m].

    Sizes count, except of position and time; of several recordings, the worst one stands for time.
    residual: (W, T, n) [rad or m].
    """
    x = _variables(loop, joint)[variable]
    names = [f"{third} third of {variable}" for third in THIRDS]
    if variable not in ("position", "time"):
        x, names = np.abs(x), [f"{third} third of |{variable}|" for third in THIRDS]
    place = np.searchsorted(np.quantile(x, [1 / 3, 2 / 3]), x)
    paths = [loop.grids[g].path for g, _ in loop.places]
    if variable == "time" and len(set(paths)) > 1:
        files = list(dict.fromkeys(paths))
        place = np.repeat([files.index(path) for path in paths], residual.shape[1])
        names = [f"recording {path}" for path in files]
    square = residual[:, :, joint].ravel() ** 2
    rms = [float(np.sqrt(np.mean(square[place == k]))) if np.any(place == k) else 0.0 for k in range(len(names))]
    worst = int(np.argmax(rms))
    return names[worst], rms[worst]


def _variables(loop: ClosedLoop, joint: int) -> dict[str, Array]:
    """Values (W T,) of the variables at the rows of all windows."""
    span = loop.starts[:, None] + np.arange(loop.rows + 1)
    return {
        "position": loop.motion.q[span, joint].ravel(),
        "velocity": loop.motion.v[span, joint].ravel(),
        "acceleration": loop.motion.a[span, joint].ravel(),
        "torque": loop.torque[span, joint].ravel(),
        "time": np.linspace(0, 1, span.size),
    }


def _explained(x: Array, y: Array) -> float:
    edges = np.quantile(x, np.linspace(0, 1, BINS + 1)[1:-1])
    place = np.searchsorted(edges, x)
    total = np.bincount(place, minlength=BINS).astype(float)
    mean = np.bincount(place, weights=y, minlength=BINS) / np.maximum(total, 1)
    return float(np.sum(total * mean**2))
