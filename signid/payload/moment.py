"""Pieces of a recording, and the moment at which a payload is picked up."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from ..errors import RecordingError
from ..regression.factors import window_factors
from ..regression.rows import Rows, read_rows
from ..regression.session import Part, Session
from ..types import Array, Indices

MIN_PIECE_DURATION = 0.5  # [s] duration of a piece
MAX_PIECES = 240  # pieces of a recording
MAX_SUM_ENTRIES = 2**24  # largest number of entries of all sums: 128 MB
MIN_LOAD_DURATION = 2.0  # [s] shortest time with the load, and without it
NORMAL_RIDGES = (1e-8, 1e-6, 1e-4, 1e-2)  # [1] added to the scaled diagonal in turn, until it is positive
EDGE_LOG_LIKELIHOOD = 20.0  # [1] log-likelihood below that of the best edge, from which on an edge is none
MOMENT_ROUNDS = 4  # of the search for one moment with the other one fixed
MIN_LOAD_REDUCTION = 60.0  # [1] of the squared residual by a load, over its variance, as in `signid.watch`
MIN_SECOND_REDUCTION = 0.02  # [1] least further reduction by a second moment, over that of the first
BATCH_DURATION = 1.0  # [s] residuals of different batches count as independent


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
    most = min(MAX_PIECES, max(16, MAX_SUM_ENTRIES // entries))
    return max(1, round(MIN_PIECE_DURATION * rate), int(np.ceil(total / most)))


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


class ChangeSums(NamedTuple):
    """Cumulative sums (P + 1, ...) over pieces, weighted by the noise of each joint."""

    normal: Array  # (P + 1, b + 1, b + 1) [products of the units of base, and 1, inverted]
    changes: Array  # (b, k) [units of base per change] base parameters that change: load, then friction and offsets
    precision: Array  # (k,) [1] prior precision of the changes; 0 for the load
    load: int  # number of columns of the load

    def on(self, low: int, high: int) -> Array:
        """Sum over pieces low..high."""
        return np.asarray(self.normal[high] - self.normal[low])


class Explained(NamedTuple):
    """Least squares with a change in the pieces low..high."""

    power: float  # [1] squared torque that it explains, prior included
    base: Array  # (b,) [units of base]
    change: Array  # (k,) [units of the changes]


def sums(pieces: Pieces, noise: Array, columns: Array, nuisance: Array, sizes: Array) -> ChangeSums:
    """Sums over pieces, with the changes of base parameters that a load and friction cause.

    noise: (n,) [N.m or N]; columns: (b, r) [units of base per unit] of a load; nuisance: (b, l) [1] of friction and
    offsets; sizes: (l,) [units of base] their standard deviations.
    """
    weighted = pieces.weighted(noise, len(columns))
    total = np.concatenate([np.zeros((1, *weighted.shape[1:])), np.cumsum(weighted, axis=0)])
    changes = np.concatenate([columns, nuisance * sizes], axis=1)
    precision = np.concatenate([np.zeros(columns.shape[1]), np.ones(len(sizes))])
    return ChangeSums(total, changes, precision, columns.shape[1])


def explain(known: ChangeSums, low: int, high: int, load: bool = True) -> Explained:
    """Fit base parameters everywhere, and changes in the pieces low..high, with the load or without it."""
    first = 0 if load else known.load
    changes, precision = known.changes[:, first:], known.precision[first:]
    whole, part = known.normal[-1], known.on(low, high)
    b = len(changes)
    cross = part[:b, :b] @ changes
    normal = np.block([[whole[:b, :b], cross], [cross.T, changes.T @ cross + np.diag(precision)]])
    right = np.concatenate([whole[:b, b], changes.T @ part[:b, b]])
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    solution = _solve(normal / np.outer(size, size), right / size) / size
    return Explained(float(right @ solution), solution[:b], solution[b:])


def _solve(normal: Array, right: Array) -> Array:
    """Solution (k,) of normal equations with a unit diagonal."""
    for ridge in NORMAL_RIDGES:
        with suppress(np.linalg.LinAlgError):
            factor = cho_factor(normal + ridge * np.eye(len(right)), lower=True, check_finite=False)
            return np.asarray(cho_solve(factor, right, check_finite=False))
    return np.asarray(np.linalg.lstsq(normal, right, rcond=NORMAL_RIDGES[0])[0])


def search(known: ChangeSums, pieces: Pieces, inflated: float) -> tuple[int, int]:
    """Pieces low..high that differ: to the end, from the beginning, or in between if that is clearly better.

    `inflated` is the variance of residuals over that of noise. (0, 0): the recording is too short.
    """
    count, t = len(pieces.start), pieces.edges
    inner = [k for k in range(1, count) if t[k] - t[0] >= MIN_LOAD_DURATION and t[-1] - t[k] >= MIN_LOAD_DURATION]
    if not inner:
        return 0, 0

    def power(ends: tuple[int, int]) -> float:
        return explain(known, *ends).power

    first = max(inner, key=lambda k: power((k, count)))
    both = max(first, inner[0]), count
    for _ in range(MOMENT_ROUNDS):
        before = both
        low, high = both
        both = max(((low, k) for k in (*inner, count) if t[k] - t[low] >= MIN_LOAD_DURATION), key=power)
        both = max(((k, both[1]) for k in inner if t[both[1]] - t[k] >= MIN_LOAD_DURATION), key=power)
        if both == before:
            break
    low, high = both
    beside = power(both) - power((first, count))
    load = power((first, count)) - explain(known, first, count, load=False).power
    clearly = high < count and beside > max(MIN_LOAD_REDUCTION * inflated, MIN_SECOND_REDUCTION * load)
    return both if clearly else (first, count)


def residual_std(pieces: Pieces, known: ChangeSums, low: int, high: int) -> Array:
    """Standard deviation (n,) [N.m or N] of what the fit with the load leaves of each joint's torque."""
    found = explain(known, low, high)
    inside = np.zeros(len(pieces.start), bool)
    inside[low:high] = True
    loaded = found.base + known.changes @ found.change
    out = np.empty(len(pieces.grams))
    for j, (gram, columns) in enumerate(zip(pieces.grams, pieces.columns, strict=True)):
        left = 0.0
        for which, base in ((~inside, found.base), (inside, loaded)):
            x = np.append(-base[columns], 1.0)
            left += float(x @ gram[which].sum(axis=0) @ x)
        power = float(gram[:, -1, -1].sum())
        rows = float(pieces.counts[:, j].sum())
        out[j] = np.sqrt(max(left, 1e-12 * power, 1e-300) / max(rows, 1.0))
    return out


def inflation(pieces: Pieces, known: ChangeSums, low: int, high: int) -> float:
    """Variance of the sums of load columns times residual over batches, over that of white noise [1], at least 1."""
    found = explain(known, low, high)
    b = len(found.base)
    columns = known.changes[:, : known.load]
    loaded = found.base + known.changes @ found.change
    batch = np.unique(((pieces.start - pieces.start[0]) // BATCH_DURATION).astype(int), return_index=True)[1]
    edges = np.append(batch, len(pieces.start))
    spread, white = np.zeros((known.load,) * 2), np.zeros((known.load,) * 2)
    for a, z in zip(edges, edges[1:], strict=False):
        part = known.on(int(a), int(z))
        base = loaded if low <= a < high else found.base
        score = columns.T @ (part[:b, b] - part[:b, :b] @ base)
        spread += np.outer(score, score)
        white += columns.T @ part[:b, :b] @ columns
    size = np.sqrt(np.maximum(np.diag(white), 1e-300))
    values, vectors = np.linalg.eigh(white / np.outer(size, size))
    seen = values > 1e-6 * values[-1]
    root = vectors[:, seen] / np.sqrt(values[seen]) / size[:, None]
    return max(1.0, float(np.mean(np.diag(root.T @ spread @ root))))


def rival(pieces: Pieces, known: ChangeSums, noise: Array, ends: tuple[int, int], friction: Array) -> tuple[int, float]:
    """Joint whose own friction, offset and gain explain the change best, and the power that they explain [1].

    noise: (n,) [N.m or N]; friction: (b, l) [1] columns of the coefficients that may change freely.
    """
    low, high = ends
    base = explain(known, low, high, load=False).base
    b, best = len(base), (0, -np.inf)
    weighted = known.normal[-1], known.on(low, high)
    for j, (gram, columns) in enumerate(zip(pieces.grams, pieces.columns, strict=True)):
        own = friction[:, np.abs(friction[columns]).sum(axis=0) > 0]
        part = np.zeros((b + 1, b + 1))
        at = np.append(columns, b)
        part[np.ix_(at, at)] = gram[low:high].sum(axis=0) / noise[j] ** 2
        changes = np.column_stack([own, base])  # the gain scales the joint's own torque
        cross = part[:b, :b] @ changes
        normal = np.block([[weighted[0][:b, :b], cross], [cross.T, changes.T @ cross]])
        right = np.concatenate([weighted[0][:b, b], changes.T @ part[:b, b]])
        size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        power = float(right @ (_solve(normal / np.outer(size, size), right / size) / size))
        best = max(best, (j, power), key=lambda one: one[1])
    return best


def edge_scores(pieces: Pieces, noise: Array, before: Array, after: Array, inflated: float) -> Array:
    """Log-likelihood (P - 1,) of a moment at each inner edge, but for a constant.

    Base parameters before (b,) and after (b,) the moment [units of base]; noise (n,) [N.m or N].
    """
    weighted = pieces.weighted(noise, len(before))
    left = [np.einsum("i,pij,j->p", x, weighted, x) for x in (np.append(-before, 1.0), np.append(-after, 1.0))]
    total = np.cumsum(left[0])[:-1] + np.cumsum(left[1][::-1])[::-1][1:]
    return np.asarray(-0.5 * total / inflated)


def plausible(pieces: Pieces, scores: Array) -> tuple[float, float]:
    """Earliest and latest time [s] that a moment could have, by the scores (P - 1,) [1] of the inner edges."""
    likely = np.flatnonzero(scores > scores.max() - EDGE_LOG_LIKELIHOOD) + 1
    return float(pieces.stop[likely[0] - 1]), float(pieces.start[likely[-1]])


def posterior(fine: Pieces, scores: Array) -> tuple[float, float]:
    """Moment and its standard deviation [s] by the scores (P - 1,) [1] of the inner edges.

    The moment is equally likely at all instants between two rows.
    """
    edges, width = fine.edges[1:-1], np.maximum(fine.gaps[1:-1], 1e-9)
    weight = np.exp(scores - scores.max()) * width
    weight /= weight.sum()
    mean = float(weight @ edges)
    return mean, float(np.sqrt(weight @ ((edges - mean) ** 2 + width**2 / 12)))
