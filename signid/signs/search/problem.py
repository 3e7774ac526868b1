"""Segments -> boolean least squares: one sign per segment, all parameters eliminated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...types import Array, Frozen, Indices
from ..rows.observations import Observed
from ..rows.segments import Segment

RANK = 1e-7  # [largest singular value of the scaled rows] smaller ones count as zero; heuristic


class KnownRows(NamedTuple):
    """Rows with a known right-hand side: joints whose torque has its sign, and priors."""

    matrix: Array  # (k, b) [standard deviations per unit of base]
    target: Array  # (k,) [standard deviations]


@dataclass(frozen=True, eq=False)
class SignProblem(Frozen):
    """Boolean least squares: minimise J(s) = sum_i T_i - |B s|^2 over s in {-1, 1}^S.

    With Y_i the weighted rows of segment i and u_i its weighted absolute torque, J(s) is the minimum over the base
    parameters theta of sum_i |Y_i theta - s_i u_i|^2. In coordinates z in which the stacked rows U are orthonormal,
    b_i = U_i' u_i (column i of B), T_i = u_i' u_i and A_i = U_i' U_i; the minimiser for given signs is z = B s.
    Rows with a known right-hand side are the last segment, of joint -1 and sign +1. J(s) = J(-s).
    """

    projections: Array  # (r, S) B [standard deviations]
    energies: Array  # (S,) T [squared standard deviations]
    grams: Array  # (S, r, r) A [1]
    joints: Indices  # (S,) joint of each segment, -1: known right-hand side
    back: Array  # (b, r) theta = back @ z [units of base]
    forward: Array  # (r, b) z = forward @ theta [standard deviations per unit of base]

    @property
    def count(self) -> int:
        """S, the known segment included."""
        return len(self.energies)

    @property
    def anchored(self) -> bool:
        """Whether the last segment has a known right-hand side."""
        return bool(len(self.joints)) and self.joints[-1] < 0

    def coordinates(self, signs: Array) -> Array:
        """Minimiser z = B s for given signs: (r,), or (r, k) [standard deviations].

        Args:
            signs: (S,) or (S, k) s [1].
        """
        return np.asarray(self.projections @ signs)

    def loss(self, signs: Array) -> float:
        """J(s), at least 0 [squared standard deviations].

        Args:
            signs: (S,) s [1].
        """
        return max(float(self.energies.sum() - np.sum(self.coordinates(signs) ** 2)), 0.0)

    def value(self, signs: Array) -> Array:
        """Base parameters theta = back B s that minimise the loss for given signs: (b,) [units of base].

        Args:
            signs: (S,) s [1].
        """
        return np.asarray(self.back @ self.coordinates(signs))


def build_problem(
    observed: Observed, segments: Sequence[Segment], weights: Array, known: KnownRows | None = None
) -> SignProblem:
    """Build the problem of some segments.

    Args:
        observed: observations.
        segments: segments of the joints whose torque has no sign; their samples near reversals are left out.
        weights: (n,) [1/N.m or 1/N] weight of each joint's torque.
        known: rows with a known right-hand side.
    """
    inside = [_steady_samples(observed, s) for s in segments]
    rows = [observed.rows(s.joint, at) * weights[s.joint] for s, at in zip(segments, inside, strict=True)]
    right = [np.abs(observed.torque[at, s.joint]) * weights[s.joint] for s, at in zip(segments, inside, strict=True)]
    if known is not None and len(known.target):
        rows, right = [*rows, known.matrix], [*right, known.target]
    return eliminate(rows, right, [s.joint for s in segments] + [-1] * (len(rows) - len(segments)))


def eliminate(rows: Sequence[Array], right: Sequence[Array], joints: Sequence[int]) -> SignProblem:
    """Eliminate the base parameters from the rows of S segments.

    Args:
        rows: S arrays Y_i (k, b) [standard deviations per unit of base].
        right: S arrays u_i (k,) [standard deviations]: absolute torque, or a known right-hand side.
        joints: joint of each segment; the last is -1 if its right-hand side is known.

    Source: variable projection: Golub, Pereyra, SIAM J. Numer. Anal. 10(2), 1973.
    """
    stacked = np.concatenate(rows)
    orthonormal, back = orthonormalise(stacked)
    parts = np.split(orthonormal, np.cumsum([len(r) for r in right])[:-1])
    return SignProblem(
        projections=np.column_stack([u.T @ r for u, r in zip(parts, right, strict=True)]),
        energies=np.array([r @ r for r in right]),
        grams=np.array([u.T @ u for u in parts]),
        joints=np.array(joints, dtype=np.intp),
        back=back,
        forward=orthonormal.T @ stacked,
    )


def signed_rows(observed: Observed, weights: Array) -> KnownRows:
    """Rows of the joints whose torque has its sign.

    Args:
        observed: observations.
        weights: (n,) [1/N.m or 1/N] weight of each joint's torque.
    """
    joints = np.flatnonzero(observed.known & observed.signed).tolist()
    matrix = [observed.rows(j, observed.steady[:, j]) * weights[j] for j in joints]
    target = [observed.torque[observed.steady[:, j], j] * weights[j] for j in joints]
    nothing = np.zeros((0, observed.count))
    return KnownRows(np.concatenate([nothing, *matrix]), np.concatenate([np.zeros(0), *target]))


def orthonormalise(rows: Array) -> tuple[Array, Array]:
    """Orthonormal U (M, r) that spans the columns of the rows, and back (b, r) with rows @ back = U.

    Args:
        rows: (M, b) stacked rows [any].
    """
    size = np.linalg.norm(rows, axis=0)
    size[size < 1e-12 * max(float(size.max(initial=0.0)), 1e-300)] = np.inf
    q, r = np.linalg.qr(rows / size)
    left, singular, right = np.linalg.svd(r)
    rank = int(np.sum(singular > RANK * singular[0]))
    return q @ left[:, :rank], (right[:rank].T / singular[:rank]) / size[:, None]


def _steady_samples(observed: Observed, segment: Segment) -> Indices:
    at = np.arange(segment.start, segment.stop)
    steady = at[observed.steady[at, segment.joint]]
    return steady if len(steady) else at
