"""Rows in which a log has content of its own: one of several where it was interpolated, or repeated."""

from __future__ import annotations

import numpy as np

from ...types import Array

MOST = 20  # rows from one with content to the next
EVEN = 0.02  # [1] accepted difference of steps of time from their median
FEW = 8  # rows with content, below which nothing is concluded
REST = 1e-4  # share of the power of differences in all other rows, below which they have no content (rounding)


def content_rows(t: Array, q: Array) -> slice:
    """Rows with content of their own, of N rows of positions.

    t: (N,) [s]; q: (N, n) [rad or m]. Where positions repeat, their first differences are zero in all rows but every
    k-th; where they are interpolated linearly, their second differences. All rows if neither holds.
    """
    if len(t) < 3 or not np.isfinite(q).all():
        return slice(None)
    steps, moving = np.diff(t), np.ptp(q, axis=0) > 0
    if not moving.any() or np.abs(steps - np.median(steps)).max() > EVEN * np.median(steps):
        return slice(None)
    for order in (1, 2):
        power = np.sum((np.diff(q[:, moving], order, axis=0) / np.ptp(q[:, moving], axis=0)) ** 2, axis=1)
        for k in range(min(MOST, len(power) // FEW), 1, -1):
            share = np.array([power[first::k].sum() for first in range(k)]) / max(power.sum(), 1e-300)
            first = int(np.argmax(share))
            if 1 - share[first] < REST and np.count_nonzero(power[first::k] > REST * power.mean()) >= FEW:
                return slice((first + 1) % k, None, k)
    return slice(None)


def content_rate(t: Array, q: Array) -> float:
    """Rate [Hz] of the rows with content of their own; t: (N,) [s]; q: (N, n) [rad or m]."""
    return float(1 / np.median(np.diff(t[content_rows(t, q)])))
