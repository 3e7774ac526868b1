"""The quiet stretch: noise of the residual, its peaks, its correlation in time, and the offset of the model there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Array, Indices
from .frames import COLUMNS, LOCAL, Frames

BATCH = 1.0  # [s] residuals of different batches count as independent
SHRINK = 2.0  # [batches] without correlation that are added to those measured
NEAREST = 1e-9  # [1] smallest noise over the rms of the predicted torque
ENOUGH = 20  # frames of a joint that give its noise


@dataclass(frozen=True, eq=False)
class QuietNoise:
    """Noise of n joints in the quiet stretch."""

    filtered: Array  # (n,) [N.m or N] standard deviation of the observer's residual
    peak: Array  # (n,) [N.m or N] its largest magnitude
    frame: Array  # (n,) [N.m or N] standard deviation of the residual of a frame
    inflation: Array  # (n, 14) [1] variance of the score of a column over that of white noise
    base: Array  # (n, 4) [units of the laws] coefficients of LOCAL that the quiet stretch has already


class Quiet:
    """Sums over the quiet stretch; memory grows with its duration, which is limited."""

    def __init__(self, joints: int) -> None:
        self.frames: list[tuple[Array, Array, Array, Array]] = []  # t, residual, columns, usable
        self.moved = 0.0  # [s] with a moving joint
        self.total = 0.0  # [s]

    def add(self, frames: Frames, step: float) -> None:
        """Count frames of `step` [s]."""
        self.frames.append((frames.t, frames.residual, frames.columns, frames.usable))
        self.moved += step * float(frames.moving.any(axis=1).sum())
        self.total += step * len(frames.t)

    def base(self) -> tuple[Array, Array, Array]:
        """Coefficients (n, 4) of LOCAL by a ridge fit, frame noise (n,) without them, and inflation (n, 14)."""
        t, residual, columns, usable = (np.concatenate(x) for x in zip(*self.frames, strict=True))
        n = residual.shape[1]
        base, noise, inflation = np.zeros((n, len(LOCAL))), np.zeros(n), np.ones((n, COLUMNS))
        batch = ((t - t[0]) // BATCH).astype(int)
        for j in range(n):
            here = usable[:, j]
            if here.sum() < ENOUGH:
                here = np.ones(len(t), dtype=bool)
            x, e = columns[here, j], residual[here, j]
            own = x[:, : len(LOCAL)]
            normal = own.T @ own
            ridge = np.diag(np.diag(normal) / len(own) + 1e-300)
            base[j] = np.linalg.lstsq(normal + ridge, own.T @ e, rcond=None)[0]
            rest = e - own @ base[j]
            least = NEAREST * float(np.sqrt(np.mean(columns[:, j, 2] ** 2))) + 1e-12
            noise[j] = max(float(np.sqrt(np.sum(rest**2) / max(len(rest) - len(LOCAL), 1))), least)
            inflation[j] = _inflation(x, rest / noise[j], batch[here])
        return base, noise, inflation


def _inflation(x: Array, rest: Array, batch: Indices) -> Array:
    """Variance (14,) of the sums of columns times white residual over batches, over that of white noise [1]."""
    sums = np.zeros((batch.max() + 1, x.shape[1]))
    np.add.at(sums, batch, x * rest[:, None])
    power = np.sum(x**2, axis=0)
    count = len(np.unique(batch))
    measured = np.sum(sums**2, axis=0) / np.maximum(power, 1e-300)
    return np.asarray(np.maximum((measured * count + SHRINK) / (count + SHRINK), 1.0))
