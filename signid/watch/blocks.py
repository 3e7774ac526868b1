"""Rows -> blocks of a few milliseconds between edges with position, velocity and torque."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..types import Array, Indices
from .intake import StreamRows, mean_step

VELOCITY_HALF_WINDOW = 0.008  # [s] half of the window of the velocity: a local line; the delay of the observer
MIN_BLOCK_TIME = 0.002  # [s] shortest block
PERIOD_ROWS = 20  # rows that give the sampling period


class Blocks(NamedTuple):
    """K blocks between K + 1 edges."""

    t: Array  # (K+1,) [s]
    q: Array  # (K+1, n) [rad or m]
    v: Array  # (K+1, n) [rad/s or m/s]
    tau: Array  # (K+1, n) [N.m or N], through the filter of the velocity
    late: float  # [s] between the last edge and the last row that it needs

    @property
    def step(self) -> Array:
        """Durations (K, 1) [s]."""
        return np.asarray(np.diff(self.t)[:, None])


class Cutter:
    """Rows of the current stretch that later edges need."""

    def __init__(self) -> None:
        self.rows: StreamRows | None = None
        self.at, self.half, self.every = 0, 0, 0

    def restart(self) -> None:
        """Begin a new stretch."""
        self.rows, self.at = None, self.half

    def cut(self, rows: StreamRows) -> Blocks | None:
        """Append rows; the blocks that are complete, or None."""
        self.rows = rows = rows if self.rows is None else self.rows.then(rows)
        if not self.half:
            if len(rows.t) < PERIOD_ROWS:
                return None
            period = mean_step(np.diff(rows.t))
            self.half, self.every = max(1, round(VELOCITY_HALF_WINDOW / period)), max(1, round(MIN_BLOCK_TIME / period))
            self.at = self.half
        edges = np.arange(self.at, len(rows.t) - self.half, self.every)
        if len(edges) < 2:
            return None
        found = _blocks(rows, edges, self.half)
        self.rows, self.at = rows.at(slice(edges[-1] - self.half, None)), self.half
        return found


def _blocks(rows: StreamRows, edges: Indices, half: int) -> Blocks:
    """Edges with the velocity of a local line; position, torque and time through the filter that this line is.

    The slope of a line through samples is a weighted mean of the velocities between them, for any stamps; torque has
    the same weights, so that both have the same acceleration in them, also where rows were lost.
    """
    around = edges[:, None] + np.arange(-half, half + 1)
    times = rows.t[around] - rows.t[edges][:, None]
    slope = times - times.mean(axis=1, keepdims=True)
    slope /= np.sum(slope**2, axis=1, keepdims=True)
    between = (np.cumsum(slope[:, ::-1], axis=1)[:, ::-1][:, 1:] * np.diff(times, axis=1)) / 2
    weight = np.zeros_like(slope)
    weight[:, 1:] += between
    weight[:, :-1] += between
    moved = rows.q[around] - rows.q[edges][:, None]
    mean = ("kw,kwn->kn", weight)
    v = np.einsum("kw,kwn->kn", slope, moved) if rows.dq is None else np.einsum(*mean, rows.dq[around])
    q, tau = rows.q[edges] + np.einsum(*mean, moved), np.einsum(*mean, rows.tau[around])
    t = rows.t[edges] + np.sum(weight * times, axis=1)
    return Blocks(t, q, v, tau, float(rows.t[edges[-1] + half] - t[-1]))
