"""Rows -> factors: additive sums and a sample of rows, of a size that does not grow with the recording."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import reduce as fold
from typing import Any, NamedTuple

import numpy as np

from ..types import Array, Frozen, Indices, Mask
from .rows import Rows, Task

MAX_SAMPLE_ROWS = 512  # largest number of rows; with 256, intervals of real recordings contain the truth less often
MIN_ROW_LIMIT = 128  # smallest limit on the number of rows, for many columns
MAX_COLUMN_ENTRIES = 2**18  # largest number of entries of `columns` above that: 2 MB
SAMPLE_ARRAYS = ("number", "q", "v", "a", "torque", "slope", "kept", "columns")  # arrays of a `RowSample`
LAGS = 6  # highest order of the autoregressive noise model
Weigh = Callable[[int, Rows], Array]  # (joint, rows) -> weight (M,) [1] of each row


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
    a: Array  # (K, n) [rad/s2 or m/s2]
    torque: Array  # (K, n) [N.m or N]
    slope: Array  # (K, n) [N.m/s or N/s] derivative of the torque
    kept: Mask  # (K, n) whether the row of the joint is valid
    columns: Array  # (K, c) [torque per unit of the base parameter], joint by joint

    def __add__(self, other: RowSample) -> RowSample:
        both: dict[str, Any] = {key: np.concatenate([getattr(self, key), getattr(other, key)]) for key in SAMPLE_ARRAYS}
        return _thinned(replace(self, stride=max(self.stride, other.stride), **both))

    def of(self, joint: int, seen: Sequence[Indices]) -> Array:
        """Columns (K, m) of one joint [torque per unit of the base parameter]; `seen` are those of all joints."""
        start = sum(len(columns) for columns in seen[:joint])
        return self.columns[:, start : start + len(seen[joint])]


def sample_rows(task: Task, window: Rows, weights: Sequence[Array] | None = None) -> RowSample:
    """Sample of consecutive rows, with robust weights (M,) per joint [1], in [0, 1]."""
    period = task.band.factor / task.band.rate
    kept = window.steady & window.recorded
    root = [np.sqrt(w) for w in weights] if weights else [np.ones(len(kept))] * kept.shape[1]
    scale = np.where(kept, np.column_stack(root), 0.0)
    columns = [x * scale[:, j, None] for j, x in enumerate(window.columns)]
    joined = np.concatenate(columns, axis=1)
    signals = (window.q, window.v, window.a, window.torque * scale, window.slope * scale, joined)
    q, v, a, torque, slope, joined = (
        x.astype(np.float32).astype(np.float64) for x in signals
    )  # halves the size of files
    number = int(np.floor(window.t[0] / period)) + np.arange(len(window.t)) if len(window.t) else np.zeros(0, np.intp)
    return _thinned(RowSample(number, period, 1, q, v, a, torque, slope, kept, joined))


def _thinned(sample: RowSample) -> RowSample:
    """Sample at the smallest stride that satisfies the limits."""
    most = int(np.clip(MAX_COLUMN_ENTRIES // max(sample.columns.shape[1], 1), MIN_ROW_LIMIT, MAX_SAMPLE_ROWS))
    stride, here = sample.stride, sample.number % sample.stride == 0
    while np.count_nonzero(here) > most:
        stride *= 2
        here = sample.number % stride == 0
    if here.all():
        return replace(sample, stride=stride)
    return replace(sample, stride=stride, **{key: getattr(sample, key)[here] for key in SAMPLE_ARRAYS})


@dataclass(frozen=True, eq=False)
class JointFactors(Frozen):
    """Sums over one joint's rows z = [instruments x y]: m columns x, torque y; masked rows are zero.

    grams[d] = sum over k of z[k] z[k-d]'; `whole` is the sum over all rows, masked or not, of [x y]'[x y].
    """

    grams: Array  # (d, c, c) [products of the units of z], c = m + 1, or 2 m + 1 with instruments
    counts: Array  # (d,) [1] pairs of valid rows at each lag
    whole: Array  # (m + 1, m + 1) [products of the units of x, y]
    total: float  # [N.m or N] sum of y over all rows
    rows: int

    def __add__(self, other: JointFactors) -> JointFactors:
        return JointFactors(*(getattr(self, each.name) + getattr(other, each.name) for each in fields(self)))


@dataclass(frozen=True, eq=False)
class Factors(Frozen):
    """Factors of all joints, and statistics of the motion. They add over recordings, chunks and machines."""

    joints: tuple[JointFactors, ...]
    columns: tuple[Indices, ...]  # per joint (m,) base parameters that its torque depends on
    instruments: bool
    lower: Array  # (n,) [rad or m]
    upper: Array  # (n,) [rad or m]
    velocity: Array  # (n, n) [rad2/s2] sum of v v'
    acceleration: Array  # (n,) [rad2/s4] sum of a squared
    rows: int
    sample: RowSample | None = None  # sample of the rows; None for white noise
    parts: tuple[tuple[str, Factors], ...] = ()  # of each recording, with its SHA-256

    def __add__(self, other: Factors) -> Factors:
        one, two = dict(self.parts), dict(other.parts)
        return Factors(
            tuple(a + b for a, b in zip(self.joints, other.joints, strict=True)),
            self.columns,
            self.instruments,
            np.minimum(self.lower, other.lower),
            np.maximum(self.upper, other.upper),
            self.velocity + other.velocity,
            self.acceleration + other.acceleration,
            self.rows + other.rows,
            self.sample + other.sample if self.sample and other.sample else None,
            tuple({**one, **{key: one[key] + x if key in one else x for key, x in two.items()}}.items()),
        )


class Node(NamedTuple):
    """Sum over 2**level windows of rows; `start` is the number of the first window."""

    start: int
    level: int
    factors: Factors


def reduce_rows(task: Task, rows: Iterable[Rows], lags: int = LAGS, weigh: Weigh | None = None) -> Factors:
    """Factors of all rows, in one pass, as the sum over `window_factors`."""
    nodes = cascade(Node(k, 0, one) for k, one in enumerate(window_factors(task, rows, lags, weigh)))
    return total_factors(nodes) or _empty_factors(task, lags)


def window_factors(task: Task, rows: Iterable[Rows], lags: int = LAGS, weigh: Weigh | None = None) -> Iterator[Factors]:
    """Factors of each of consecutive windows of rows, of one recording or of several, up to the highest lag.

    Each row has a robust weight in [0, 1], or 1.
    """
    seen = tuple(map(np.flatnonzero, task.base.sees))
    empty = tails = [np.zeros((0, c + 1)) for c in _widths(task)]
    for window in rows:
        if window.first:
            tails = empty
        weights = [weigh(j, window) for j in range(len(seen))] if weigh else None
        found = [_reduce_joint(window, j, tail, lags, weights[j] if weights else None) for j, tail in enumerate(tails)]
        tails = [tail for _, tail in found]
        yield Factors(
            tuple(part for part, _ in found),
            seen,
            task.instruments,
            window.q.min(0),
            window.q.max(0),
            window.v.T @ window.v,
            (window.a**2).sum(0),
            len(window.t),
            sample_rows(task, window, weights) if lags else None,
        )


def cascade(nodes: Iterable[Node]) -> list[Node]:
    """Pairwise sums of neighbouring nodes, as far as pairs are complete. Nodes ascend without overlap.

    The order of all additions follows from the numbers of the windows alone. So the sum is the same to the last bit on
    whichever machine its parts were computed, and rounding errors hardly grow with the number of windows.

    Source: pairwise summation: Higham, Accuracy and Stability of Numerical Algorithms, 2002, section 4.2.
    """
    stack: list[Node] = []
    for node in nodes:
        while stack and stack[-1].level == node.level and node.start == stack[-1].start + 2**node.level:
            if stack[-1].start % 2 ** (node.level + 1):
                break
            left = stack.pop()
            node = Node(left.start, node.level + 1, left.factors + node.factors)
        stack.append(node)
    return stack


def total_factors(nodes: Sequence[Node]) -> Factors | None:
    """Sum of the nodes of a cascade, the smallest first; None if there is no node."""
    return fold(lambda right, left: left.factors + right, nodes[-2::-1], nodes[-1].factors) if nodes else None


def _reduce_joint(window: Rows, j: int, tail: Array, lags: int, weight: Array | None) -> tuple[JointFactors, Array]:
    """Factors of the joint, and the last rows for the lags of the next window."""
    known, old, m = bool(window.recorded[j]), len(tail), window.columns[j].shape[1]
    keep = window.steady[:, j] & known
    parts = [window.columns[j], window.torque[:, j, None]]
    parts = parts if window.instruments is None else [window.instruments[j], *parts]
    z = np.empty((old + len(keep), tail.shape[1]))
    c = z.shape[1] - 1
    z[:old], z[old:, c] = tail, keep
    rows = np.concatenate(parts, axis=1, out=z[old:, :c])
    plain = rows[:, c - m - 1 :]
    total, masked = float(plain[:, m].sum()), plain[~keep]
    whole = None if weight is None else plain.T @ plain
    rows[~keep] = 0
    if weight is not None:
        rows *= np.sqrt(weight)[:, None]
    grams, counts = np.zeros((lags + 1, c, c)), np.zeros(lags + 1)
    for d in range(lags + 1):
        start = max(old, d)
        now, before = z[start:], z[start - d : max(len(z), start) - d]
        grams[d] = now[:, :c].T @ before[:, :c]
        counts[d] = now[:, c] @ before[:, c]
    whole = grams[0, c - m - 1 :, c - m - 1 :] + masked.T @ masked if whole is None else whole
    share = float(known)  # 0 if the torque is not recorded
    return JointFactors(grams, counts, share * whole, share * total, known * len(keep)), z[max(0, len(z) - lags) :]


def _widths(task: Task) -> list[int]:
    """Number of columns in the factors of each joint."""
    sides = 2 if task.instruments else 1
    return [sides * int(seen.sum()) + 1 for seen in task.base.sees]


def _empty_factors(task: Task, lags: int) -> Factors:
    seen, n = tuple(map(np.flatnonzero, task.base.sees)), len(task.base.sees)
    empty = tuple(
        JointFactors(np.zeros((lags + 1, c, c)), np.zeros(lags + 1), np.zeros((len(columns) + 1,) * 2), 0.0, 0)
        for columns, c in zip(seen, _widths(task), strict=True)
    )
    zeros = np.zeros(n)
    return Factors(empty, seen, task.instruments, zeros + np.inf, zeros - np.inf, np.zeros((n, n)), zeros, 0)
