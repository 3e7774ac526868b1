"""Pieces of one recording -> when a load was picked up, and when it was put down again.

The load's torque is a linear function of its ten inertial parameters, so each pair of moments is a problem of least
squares in sums over pieces. Friction and offsets may change a little at the same moments.
"""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from ..types import Array
from .pieces import Pieces

BRIEFEST = 2.0  # [s] shortest time with the load, and without it
RIDGES = (
    1e-8,
    1e-6,
    1e-4,
    1e-2,
)  # [1] added to the scaled diagonal, until it is positive: directions without excitation
LIKELY = 20.0  # [1] log-likelihood below that of the best edge, from which on an edge is none
ROUNDS = 4  # of the search for one moment with the other one fixed
NOTICED = 60.0  # [1] least reduction of the squared residual by a load, over its variance, as in `signid.watch`
SECOND = 0.02  # [1] least further reduction by a second moment, over that of the first
BATCH = 1.0  # [s] residuals of different batches count as independent


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
    for ridge in RIDGES:
        with suppress(np.linalg.LinAlgError):
            factor = cho_factor(normal + ridge * np.eye(len(right)), lower=True, check_finite=False)
            return np.asarray(cho_solve(factor, right, check_finite=False))
    return np.asarray(np.linalg.lstsq(normal, right, rcond=RIDGES[0])[0])


def search(known: ChangeSums, pieces: Pieces, inflated: float) -> tuple[int, int]:
    """Pieces low..high that differ: to the end, from the beginning, or in between if that is clearly better.

    `inflated` is the variance of residuals over that of noise. (0, 0): the recording is too short.
    """
    count, t = len(pieces.start), pieces.edges
    inner = [k for k in range(1, count) if t[k] - t[0] >= BRIEFEST and t[-1] - t[k] >= BRIEFEST]
    if not inner:
        return 0, 0

    def power(ends: tuple[int, int]) -> float:
        return explain(known, *ends).power

    first = max(inner, key=lambda k: power((k, count)))
    both = max(first, inner[0]), count
    for _ in range(ROUNDS):
        before = both
        low, high = both
        both = max(((low, k) for k in (*inner, count) if t[k] - t[low] >= BRIEFEST), key=power)
        both = max(((k, both[1]) for k in inner if t[both[1]] - t[k] >= BRIEFEST), key=power)
        if both == before:
            break
    low, high = both
    beside = power(both) - power((first, count))
    load = power((first, count)) - explain(known, first, count, load=False).power
    clearly = high < count and beside > max(NOTICED * inflated, SECOND * load)
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
    batch = np.unique(((pieces.start - pieces.start[0]) // BATCH).astype(int), return_index=True)[1]
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
    likely = np.flatnonzero(scores > scores.max() - LIKELY) + 1
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
