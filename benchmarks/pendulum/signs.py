"""Which sign the torque of one joint had, where only its absolute value was logged: every choice is tried.

Two coefficients make the torque, so a choice of signs costs a product with a table of two numbers per segment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

QUANTILE = 0.1  # of |torque|: below it a torque may change its sign
SHORTEST, SEARCHED = 5, 16  # samples of a segment at least, segments at most; the longest are taken


class Choice(NamedTuple):
    """The best signs of the segments, and the coefficients that go with them."""

    value: Array  # (2,) [N.m, kg.m2]
    signs: Array  # (S,) [1]
    rms: float  # N.m, of the residual
    next_rms: float  # N.m, of the second best signs; nan where there are no others


@dataclass(frozen=True)
class Signs:
    """How often the signs were right."""

    segments: int  # searched
    mixed: int  # of them, those in which the true sign changes
    right: int  # of them, those whose sign is the true one throughout
    samples: float  # %, of all samples by the model's prediction
    away: float  # %, of those whose true torque is beyond the QUANTILE
    rms: float  # N.m, of the residual
    next_rms: float  # N.m, of the second best signs

    @property
    def holds(self) -> bool:
        """Whether each segment that has a sign got it, and each sample away from zero torque."""
        return self.right + self.mixed == self.segments and self.away == 100


def segments(magnitude: Array) -> list[slice]:
    """The longest runs of |torque| above its QUANTILE, in the order of time.

    Args:
        magnitude: (N,) [N.m].
    """
    above = np.concatenate([[0], magnitude > np.quantile(magnitude, QUANTILE), [0]])
    starts, stops = (np.flatnonzero(np.diff(above) == step) for step in (1, -1))
    spans = [slice(a, b) for a, b in zip(starts.tolist(), stops.tolist(), strict=True) if b - a >= SHORTEST]
    longest = sorted(spans, key=lambda span: span.start - span.stop)[:SEARCHED]
    return sorted(longest, key=lambda span: span.start)


def search(columns: Array, magnitude: Array, spans: Sequence[slice]) -> Choice:
    """The signs with the smallest residual of least squares on the segments, and inertia positive.

    Args:
        columns: (N, 2) [1, rad/s2] sine of the position, acceleration.
        magnitude: (N,) [N.m].
        spans: S segments, each of one sign.
    """
    gram = sum(columns[span].T @ columns[span] for span in spans)
    products = np.array([columns[span].T @ magnitude[span] for span in spans])
    square = sum(float(magnitude[span] @ magnitude[span]) for span in spans)
    count = sum(span.stop - span.start for span in spans)
    choices = np.arange(2 ** (len(spans) - 1))[:, None] >> np.arange(len(spans)) & 1  # the last segment's sign stays
    sums = (1.0 - 2.0 * choices) @ products
    explained = np.sum(np.linalg.solve(np.linalg.cholesky(gram), sums.T) ** 2, axis=0)
    best, *others = np.argsort(-explained)[:2]
    rms = np.sqrt(np.maximum(square - explained, 0.0) / count)
    value, signs = np.linalg.solve(gram, sums[best]), 1.0 - 2.0 * choices[best]
    side = np.sign(value[1])
    return Choice(side * value, side * signs, float(rms[best]), float(rms[others[0]]) if others else float("nan"))


def predict(columns: Array, value: Array) -> Array:
    """Signs (N,) [1] of the torque that coefficients (2,) [N.m, kg.m2] give on columns (N, 2) [1, rad/s2]."""
    return np.where(columns @ value < 0, -1.0, 1.0)


def judge(choice: Choice, spans: Sequence[slice], columns: Array, torque: Array) -> Signs:
    """Against what truly was.

    Args:
        choice: for the segments.
        spans: S segments.
        columns: (N, 2) [1, rad/s2].
        torque: (N,) [N.m] with its true sign.
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
