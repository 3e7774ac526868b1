"""Rows -> sample of bounded size, for covariances that depend on the states of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..types import Array, Frozen, Indices, Mask
from .rows import Rows, Task

ROWS = 512  # largest number of rows; with 256, intervals of real recordings contain the truth less often
LEAST = 128  # smallest limit on the number of rows, for many columns
NUMBERS = 2**18  # largest number of entries of `columns` above that: 2 MB


@dataclass(frozen=True, eq=False)
class RowSample(Frozen):
    """K evenly spaced rows: those whose number is a multiple of `stride`, a power of two.

    Rows are numbered by time, so that the sample does not depend on the order in which parts are added.
    """

    number: Indices  # (K,) number of each row: time over `period`
    period: float  # [s] between neighbouring rows
    stride: int  # [1] spacing of the sample, in rows
    q: Array  # (K, n) [rad or m]
    v: Array  # (K, n) [rad/s or m/s]
    torque: Array  # (K, n) [N.m or N]
    slope: Array  # (K, n) [N.m/s or N/s] derivative of the torque
    kept: Mask  # (K, n) whether the row of the joint is valid
    columns: Array  # (K, c) [torque per unit of the base parameter], joint by joint

    def __add__(self, other: RowSample) -> RowSample:
        return _thinned(
            RowSample(
                np.concatenate([self.number, other.number]),
                self.period,
                max(self.stride, other.stride),
                np.concatenate([self.q, other.q]),
                np.concatenate([self.v, other.v]),
                np.concatenate([self.torque, other.torque]),
                np.concatenate([self.slope, other.slope]),
                np.concatenate([self.kept, other.kept]),
                np.concatenate([self.columns, other.columns]),
            )
        )

    def of(self, joint: int, seen: Sequence[Indices]) -> Array:
        """Columns (K, m) of one joint [torque per unit of the base parameter].

        Args:
            joint: index of the joint.
            seen: per joint, the base parameters (m,) that its torque depends on.
        """
        start = sum(len(columns) for columns in seen[:joint])
        return self.columns[:, start : start + len(seen[joint])]


def sample_rows(task: Task, window: Rows, weights: Sequence[Array] | None = None) -> RowSample:
    """Sample of a window of rows.

    Args:
        task: task of the rows.
        window: consecutive rows.
        weights: per joint, robust weight (M,) of each row, in [0, 1].
    """
    period = task.band.factor / task.band.rate
    kept = window.steady & window.recorded
    root = [np.sqrt(w) for w in weights] if weights else [np.ones(len(kept))] * kept.shape[1]
    scale = np.where(kept, np.column_stack(root), 0.0)
    columns = [x * scale[:, j, None] for j, x in enumerate(window.columns)]
    signals = (window.q, window.v, window.torque * scale, window.slope * scale, np.concatenate(columns, axis=1))
    q, v, torque, slope, joined = (_single(x) for x in signals)
    number = int(np.floor(window.t[0] / period)) + np.arange(len(window.t)) if len(window.t) else np.zeros(0, np.intp)
    return _thinned(RowSample(number, period, 1, q, v, torque, slope, kept, joined))


def _single(x: Array) -> Array:
    """Round to single precision, which halves the size of files."""
    return x.astype(np.float32).astype(np.float64)


def _thinned(sample: RowSample) -> RowSample:
    """Sample at the smallest stride that satisfies the limits."""
    most = int(np.clip(NUMBERS // max(sample.columns.shape[1], 1), LEAST, ROWS))
    stride, here = sample.stride, sample.number % sample.stride == 0
    while np.count_nonzero(here) > most:
        stride *= 2
        here = sample.number % stride == 0
    if here.all():
        return replace(sample, stride=stride)
    return RowSample(
        sample.number[here],
        sample.period,
        stride,
        sample.q[here],
        sample.v[here],
        sample.torque[here],
        sample.slope[here],
        sample.kept[here],
        sample.columns[here],
    )
