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


def worst_third(loop: ClosedLoop, residual: Array, joint: int, variable: str) -> tuple[str, float]:
    """Third of the values of a variable with the largest mismatch, and the rms there [rad or m].

    Sizes count, except of position and time. residual: (W, T, n) [rad or m].
    """
    x, signed = _variables(loop, joint)[variable], variable in ("position", "time")
    place = np.searchsorted(np.quantile(x if signed else np.abs(x), [1 / 3, 2 / 3]), x if signed else np.abs(x))
    square = residual[:, :, joint].ravel() ** 2
    rms = [float(np.sqrt(np.mean(square[place == k]))) if np.any(place == k) else 0.0 for k in range(3)]
    worst = int(np.argmax(rms))
    name = variable if signed else f"|{variable}|"
    return f"{THIRDS[worst]} third of {name}", rms[worst]


def _variables(loop: ClosedLoop, joint: int) -> dict[str, Array]:
    """Values (W T,) of the variables at the rows of all windows."""
    at = loop.along(None)
    span = loop.starts[:, None] + np.arange(loop.rows + 1)
    return {
        "position": at.motion.q[span, joint].ravel(),
        "velocity": at.motion.v[span, joint].ravel(),
        "acceleration": at.motion.a[span, joint].ravel(),
        "torque": at.torque[span, joint].ravel(),
        "time": np.linspace(0, 1, span.size),
    }


def _explained(x: Array, y: Array) -> float:
    edges = np.quantile(x, np.linspace(0, 1, BINS + 1)[1:-1])
    place = np.searchsorted(edges, x)
    total = np.bincount(place, minlength=BINS).astype(float)
    mean = np.bincount(place, weights=y, minlength=BINS) / np.maximum(total, 1)
    return float(np.sum(total * mean**2))
