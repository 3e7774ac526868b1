"""Exhaustive search for the torque signs of one joint with logged absolute torque.

The torque is linear in two coefficients, so each choice of signs costs one product with two numbers per segment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

QUANTILE = 0.1  # quantile of |torque| below which the sign may change [1]
SHORTEST, SEARCHED = 5, 16  # fewest samples per segment, most segments (the longest)


class Choice(NamedTuple):
    """Best signs of the segments and their coefficients."""

    value: Array  # (2,) [N.m, kg.m2]
    signs: Array  # (S,) [1]
    rms: float  # N.m, of the residual
    next_rms: float  # residual of the second best signs [N.m]; nan without alternatives


@dataclass(frozen=True)
class Signs:
    """Counts and shares of correct signs."""

    segments: int  # number of searched segments
    mixed: int  # segments with a change of the true sign
    right: int  # segments with the true sign throughout
    samples: float  # correct samples by the model's prediction [%]
    away: float  # the same for samples with true torque above the QUANTILE [%]
    rms: float  # N.m, of the residual
    next_rms: float  # N.m, of the second best signs

    @property
    def holds(self) -> bool:
        """Whether all unmixed segments and all samples above the QUANTILE have their true sign."""
        return self.right + self.mixed == self.segments and self.away == 100


def segments(magnitude: Array) -> list[slice]:
    """Longest runs of |torque| above its QUANTILE, in order of time.

    Args:
        magnitude: absolute torque (N,) [N.m].
    """
    above = np.concatenate([[0], magnitude > np.quantile(magnitude, QUANTILE), [0]])
    starts, stops = (np.flatnonzero(np.diff(above) == step) for step in (1, -1))
    spans = [slice(a, b) for a, b in zip(starts.tolist(), stops.tolist(), strict=True) if b - a >= SHORTEST]
    longest = sorted(spans, key=lambda span: span.start - span.stop)[:SEARCHED]
    return sorted(longest, key=lambda span: span.start)


def search(columns: Array, magnitude: Array, spans: Sequence[slice]) -> Choice:
    """Find the signs with the smallest least-squares residual on the segments and positive inertia.

    Args:
        columns: sine of the position and acceleration (N, 2) [1, rad/s2].
        magnitude: absolute torque (N,) [N.m].
        spans: segments, each of one sign.
    """
    gram = sum(columns[span].T @ columns[span] for span in spans)
    products = np.array([columns[span].T @ magnitude[span] for span in spans])
    square = sum(float(magnitude[span] @ magnitude[span]) for span in spans)
    count = sum(span.stop - span.start for span in spans)
    choices = np.arange(2 ** (len(spans) - 1))[:, None] >> np.arange(len(spans)) & 1  # the last segment's sign is fixed
    sums = (1.0 - 2.0 * choices) @ products
    explained = np.sum(np.linalg.solve(np.linalg.cholesky(gram), sums.T) ** 2, axis=0)
    best, *others = np.argsort(-explained)[:2]
    rms = np.sqrt(np.maximum(square - explained, 0.0) / count)
    value, signs = np.linalg.solve(gram, sums[best]), 1.0 - 2.0 * choices[best]
    side = np.sign(value[1])
    return Choice(side * value, side * signs, float(rms[best]), float(rms[others[0]]) if others else float("nan"))


def predict(columns: Array, value: Array) -> Array:
    """Signs (N,) [1] of the torque from columns (N, 2) [1, rad/s2] and coefficients (2,) [N.m, kg.m2]."""
    return np.where(columns @ value < 0, -1.0, 1.0)


def evaluate(choice: Choice, spans: Sequence[slice], columns: Array, torque: Array) -> Signs:
    """Compare chosen signs with the true ones.

    Args:
        choice: signs of the segments.
        spans: segments.
        columns: sine of the position and acceleration (N, 2) [1, rad/s2].
        torque: torque with its true sign (N,) [N.m].
    """
    true = np.where(torque < 0, -1.0, 1.0)
    same = predict(columns, choice.value) == true
    away = np.abs(torque) > np.quantile(np.abs(torque), QUANTILE)
    return Signs(
        segments=len(spans),
        mixed=sum(bool(np.ptp(true[span])) for span in spans),
        right=sum(bool((true[span] == sign).all()) for span, sign in zip(spans, choice.signs, strict=True)),
        samples=float(100 * same.mean()),
        away=float(100 * same[away].mean()),
        rms=choice.rms,
        next_rms=choice.next_rms,
    )
