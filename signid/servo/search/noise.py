"""Noise of measured positions: white noise by third differences, at least that of the steps of the encoder."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...servos import ServoGrid
from ...types import Array

NORMAL = 0.6745  # median of |x| of a standard normal variable
GAIN = np.sqrt(20.0)  # of third differences on white noise
LEAST = 1e-5  # [rad or m]


def position_noise(grids: Sequence[ServoGrid]) -> Array:
    """Standard deviation (n,) of the noise of measured positions [rad or m]."""
    out = []
    for j in range(len(grids[0].joints)):
        third = np.concatenate([np.diff(grid.q[:, j], 3) for grid in grids])
        steps = np.abs(np.concatenate([np.diff(grid.q[:, j]) for grid in grids]))
        jumps = steps[steps > 1e-9]
        tick = float(np.quantile(jumps, 0.02)) if len(jumps) else 0.0
        counted = np.mean(np.abs(jumps / tick - np.round(jumps / tick)) < 0.05) if tick else 0.0
        encoder = tick / np.sqrt(12) if counted > 0.9 else 0.0
        white = float(np.median(np.abs(third))) / NORMAL / GAIN
        low = float(np.sqrt(np.mean(np.sort(third**2)[: max(len(third) // 2, 1)]))) / GAIN
        out.append(max(min(white, 3 * low + encoder), encoder, LEAST))
    return np.array(out)
