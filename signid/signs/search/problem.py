"""Segments -> boolean least squares: a sign for each segment, all parameters eliminated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...types import Array, Frozen, Indices
from ..rows.observations import Observed
from ..rows.segments import Segment

RANK = 1e-7  # of the largest singular value of the scaled rows


class KnownRows(NamedTuple):
    """Rows whose right side is known: joints with signed torque, or what is believed beforehand."""

    matrix: Array  # (k, b) [standard deviations per unit of base]
    target: Array  # (k,) [standard deviations]


@dataclass(frozen=True, eq=False)
class SignProblem(Frozen):
    """Minimise J(s) = sum T - |B s|^2 over s in {-1, 1}^S.

    Coordinates z (r,) are such that the stacked rows U are orthonormal; B_i = U_i' u_i, T_i = u_i' u_i, A_i = U_i' U_i
    with u_i the absolute torque of segment i, weighted. For given signs the best parameters are z = B s.
    Rows with a known right side are the last segment, of joint -1: its sign is +1. J(s) = J(-s).
    """

    projections: Array  # (r, S) B [standard deviations]
    energies: Array  # (S,) T [squared standard deviations]
    grams: Array  # (S, r, r) A [1]
    joints: Indices  # (S,) joint of each segment, -1: known
    back: Array  # (b, r) base parameters = back @ z [units of base]
    forward: Array  # (r, b) z = forward @ base parameters [standard deviations per unit of base]

    @property
    def count(self) -> int:
        """S, with the known one."""
        return len(self.energies)

    @property
    def anchored(self) -> bool:
        """Whether the last segment is one whose sign is known."""
        return bool(len(self.joints)) and self.joints[-1] < 0

    def coordinates(self, signs: Array) -> Array:
        """Best z for signs: (r,), or (r, k) [standard deviations].

        Args:
            signs: (S,) or (S, k) [1].
        """
        return np.asarray(self.projections @ signs)

    def loss(self, signs: Array) -> float:
        """J, at least 0 [squared standard deviations].

        Args:
            signs: (S,) [1].
        """
        return max(float(self.energies.sum() - np.sum(self.coordinates(signs) ** 2)), 0.0)

    def value(self, signs: Array) -> Array:
        """Best base parameters for signs: (b,) [units of base].

        Args:
            signs: (S,) [1].
        """
        return np.asarray(self.back @ self.coordinates(signs))


def pose(
    observed: Observed, segments: Sequence[Segment], weights: Array, known: KnownRows | None = None
) -> SignProblem:
    """The problem of these segments.

    Args:
        observed: the rows.
        segments: of the joints whose torque has no sign; samples near reversals in them are left out.
        weights: (n,) [1/N.m or 1/N] of each joint's torque.
        known: rows with a known right side.
    """
    cut = [_inside(observed, s) for s in segments]
    rows = [observed.rows(s.joint, at) * weights[s.joint] for s, at in zip(segments, cut, strict=True)]
    right = [np.abs(observed.torque[at, s.joint]) * weights[s.joint] for s, at in zip(segments, cut, strict=True)]
    if known is not None and len(known.target):
        rows, right = [*rows, known.matrix], [*right, known.target]
    return eliminate(rows, right, [s.joint for s in segments] + [-1] * (len(rows) - len(segments)))


def eliminate(rows: Sequence[Array], right: Sequence[Array], joints: Sequence[int]) -> SignProblem:
    """The problem of segments by their rows.

    Args:
        rows: S of (k, b) each [standard deviations per unit of base].
        right: S of (k,) each [standard deviations] absolute torque, or what is known.
        joints: S of them, the last -1 where its right side is known.

    Source: the elimination of z is that of variable projection: Golub, Pereyra, SIAM J. Numer. Anal. 10(2), 1973.
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
        observed: the rows.
        weights: (n,) [1/N.m or 1/N] of each joint's torque.
    """
    joints = np.flatnonzero(observed.known & observed.signed).tolist()
    matrix = [observed.rows(j, observed.steady[:, j]) * weights[j] for j in joints]
    target = [observed.torque[observed.steady[:, j], j] * weights[j] for j in joints]
    nothing = np.zeros((0, observed.count))
    return KnownRows(np.concatenate([nothing, *matrix]), np.concatenate([np.zeros(0), *target]))


def orthonormalise(rows: Array) -> tuple[Array, Array]:
    """U (M, r) with U'U = 1 that spans the columns, and back (b, r): base parameters = back @ z for rows @ them = U z.

    Args:
        rows: (M, b) [any].
    """
    size = np.linalg.norm(rows, axis=0)
    size[size < 1e-12 * max(float(size.max(initial=0.0)), 1e-300)] = np.inf
    q, r = np.linalg.qr(rows / size)
    left, singular, right = np.linalg.svd(r)
    rank = int(np.sum(singular > RANK * singular[0]))
    return q @ left[:, :rank], (right[:rank].T / singular[:rank]) / size[:, None]


def _inside(observed: Observed, segment: Segment) -> Indices:
    at = np.arange(segment.start, segment.stop)
    steady = at[observed.steady[at, segment.joint]]
    return steady if len(steady) else at
