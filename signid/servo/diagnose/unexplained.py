"""Variable that a mismatch depends on most: the one whose bins explain most of its variance."""

from __future__ import annotations

import numpy as np

from ...types import Array
from .closed_loop import ClosedLoop

BINS = 9


def depends_on(loop: ClosedLoop, residual: Array, joint: int) -> str:
    """Name of the variable; residual: (W, T, n) [rad or m]."""
    at = loop.along(None)
    span = loop.starts[:, None] + np.arange(loop.rows + 1)
    size = np.linspace(0, 1, span.size).reshape(span.shape)
    variables = {
        "position": at.motion.q[span, joint],
        "velocity": at.motion.v[span, joint],
        "acceleration": at.motion.a[span, joint],
        "torque": at.torque[span, joint],
        "time": size,
    }
    y = residual[:, :, joint].ravel()
    return max(variables, key=lambda name: _explained(variables[name].ravel(), y))


def _explained(x: Array, y: Array) -> float:
    edges = np.quantile(x, np.linspace(0, 1, BINS + 1)[1:-1])
    place = np.searchsorted(edges, x)
    total = np.bincount(place, minlength=BINS).astype(float)
    mean = np.bincount(place, weights=y, minlength=BINS) / np.maximum(total, 1)
    return float(np.sum(total * mean**2))
