"""Rows of a recording -> additive factors of short pieces, each with its time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import RecordingError
from ..regression.factors import window_factors
from ..regression.rows import Rows, read_rows
from ..regression.session import Part, Session
from ..types import Array, Indices

SHORTEST = 0.5  # [s] duration of a piece
MOST = 240  # pieces of a recording
NUMBERS = 2**24  # largest number of entries of all sums: 128 MB


class Pieces(NamedTuple):
    """Sums of P consecutive pieces."""

    start: Array  # (P,) [s] first row
    stop: Array  # (P,) [s] last row
    grams: tuple[Array, ...]  # per joint (P, m + 1, m + 1) [products of units] of its m columns and its torque
    counts: Array  # (P, n) [1] rows
    columns: tuple[Indices, ...]  # per joint (m,) base parameters

    @property
    def edges(self) -> Array:
        """Times (P + 1,) [s] between the pieces."""
        return np.concatenate([self.start[:1], (self.start[1:] + self.stop[:-1]) / 2, self.stop[-1:]])

    @property
    def gaps(self) -> Array:
        """Time (P + 1,) [s] between the rows on both sides of an edge; 0 at both ends."""
        return np.concatenate([[0.0], self.start[1:] - self.stop[:-1], [0.0]])

    def part(self, low: int, high: int) -> Pieces:
        """Pieces low..high."""
        here = slice(low, high)
        grams = tuple(gram[here] for gram in self.grams)
        return Pieces(self.start[here], self.stop[here], grams, self.counts[here], self.columns)

    def weighted(self, noise: Array, rank: int) -> Array:
        """Sums (P, b + 1, b + 1) [1 / products of the units] over all joints with noise (n,) [N.m or N]."""
        whole = np.zeros((len(self.start), rank + 1, rank + 1))
        for gram, columns, std in zip(self.grams, self.columns, noise, strict=True):
            at = np.append(columns, rank)
            whole[:, at[:, None], at] += gram / std**2
        return whole


def piece_rows(session: Session, parts: Sequence[Part]) -> int:
    """Rows of a piece, so that there are neither too many nor too large sums."""
    task = session.task
    rate = task.band.rate / task.band.factor
    total = sum(sampling.length(span) for _, sampling in parts for span in sampling.spans) / task.band.factor
    entries = sum((int(seen.sum()) + 1) ** 2 for seen in task.base.sees) + (task.base.rank + 1) ** 2
    most = min(MOST, max(16, NUMBERS // entries))
    return max(1, round(SHORTEST * rate), int(np.ceil(total / most)))


def cut(session: Session, parts: Sequence[Part], size: int) -> Pieces:
    """Pieces of `size` rows; none crosses a gap.

    Raises:
        RecordingError: every stretch is shorter than the filter.
    """
    times: list[tuple[float, float]] = []
    rows = (piece for part in parts for piece in _slices(session, part, size, times))
    found = list(window_factors(session.task, rows, lags=0))
    if not found:
        raise RecordingError("no stretch of the recording is as long as the filter; record for longer")
    columns = found[0].columns
    grams = tuple(
        np.stack([one.joints[j].grams[0][-len(seen) - 1 :, -len(seen) - 1 :] for one in found])
        for j, seen in enumerate(columns)
    )
    counts = np.array([[joint.counts[0] for joint in one.joints] for one in found])
    start, stop = np.array(times).T
    return Pieces(start, stop, grams, counts, columns)


def _slices(session: Session, part: Part, size: int, times: list[tuple[float, float]]) -> Iterator[Rows]:
    for rows in read_rows(session.task, *part):
        for k in range(0, len(rows.t), size):
            here = slice(k, k + size)
            signals = {key: getattr(rows, key)[here] for key in ("t", "q", "v", "a", "torque", "slope", "steady")}
            both = {key: [x[here] for x in getattr(rows, key) or ()] for key in ("columns", "instruments")}
            times.append((float(rows.t[here][0]), float(rows.t[here][-1])))
            yield rows._replace(
                first=rows.first and k == 0,
                **signals,
                columns=both["columns"],
                instruments=None if rows.instruments is None else both["instruments"],
            )
