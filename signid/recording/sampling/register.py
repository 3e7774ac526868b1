"""Span of the register of each position, beyond which it begins again at its other end."""

from __future__ import annotations

import numpy as np

from ...types import Array, Recording
from .clock import CHUNK

FAST = 10.0  # [1] step that is a jump, over the largest usual step
USUAL = 0.995  # [1] quantile of the steps that is the largest usual one; jumps are rare
ALMOST = 0.8  # [1] smallest jump over the range of the positions: from one end to the other
NICE = (*(2 * np.pi * k for k in (1, 2, 3, 4, 5, 8, 10, 16)), 12.5, 25.0, 50.0, 95.5, 191.0)  # [rad] of known drives
NEAR = 2e-3  # [1] relative distance from a usual span at which it is that span


def register_spans(recording: Recording) -> Array:
    """Span (n,) [rad or m] of each position's register, 0 where no wrap is seen.

    A wrap is a jump from one end of the range of the positions to the other, far larger than the steps beside it; all
    jumps of a joint have the same size up to the motion in one row. Full turns, which need no end of a range, are
    removed elsewhere.
    """
    columns = recording.columns["q"]
    pieces = [
        recording.table.read(columns, start, min(start + CHUNK, len(recording)))
        for start in range(0, len(recording), CHUNK)
    ]
    q = np.concatenate(pieces)
    return np.array([_span(x[np.isfinite(x)]) for x in q.T])


def _span(q: Array) -> float:
    """Span of the register of positions q (N,) [rad or m]; 0 without a wrap."""
    step = np.diff(q)
    usual = float(np.quantile(np.abs(step), USUAL)) if len(step) > 2 else 0.0
    low, high = (float(q.min()), float(q.max())) if len(q) else (0.0, 0.0)
    jumps = np.flatnonzero(np.abs(step) > max(FAST * usual, ALMOST * (high - low), 1e-9))
    if not len(jumps) or len(jumps) > 0.01 * len(step):
        return 0.0
    ends = np.column_stack([q[jumps], q[jumps + 1]])
    width = 2 * max(usual, float(np.abs(step[np.setdiff1d(np.arange(len(step)), jumps)]).max(initial=0.0)))
    if np.any(np.minimum(ends - low, high - ends) > width + 0.05 * (high - low)):
        return 0.0
    beside = (step[np.maximum(jumps - 1, 0)] + step[np.minimum(jumps + 1, len(step) - 1)]) / 2
    if np.any(beside * step[jumps] >= 0):  # a wrap is against the motion; a value that drops out is not, there or back
        return 0.0
    sizes = np.abs(beside - step[jumps])
    span = float(np.median(sizes))
    if np.ptp(sizes) > max(width, NEAR * span) or width > 0.2 * span:
        return 0.0
    nice = min(NICE, key=lambda known: abs(known - span))
    return nice if abs(nice - span) <= NEAR * span else span
