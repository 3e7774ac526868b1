"""Segments -> boolean least squares: one sign per segment, all parameters eliminated; friction prior, certificate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..types import Array, Frozen, Indices
from .observations import Observations, Segment

FRICTION_PRIOR = {  # [rms torque of the joint, at its rms velocity] mean, standard deviation
    "torque_offset": (0.0, 0.15),
    "coulomb_friction": (0.1, 0.1),
    "viscous_friction": (0.1, 0.1),
}  # logs and simulations: trees 2 to 20 times smaller
PRIOR_STRENGTH = 0.3  # [1] weight of the friction prior; logs: at 1 it biases real data (93 % of the segments right)
ROW_RANK_TOLERANCE = 1e-7  # [largest singular value of the scaled rows] smaller ones count as zero; heuristic
ENERGY_ROUNDING = 1e-12  # [total energy] negative eigenvalues or losses of this size are rounding errors


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
        """Minimiser z = B s, (r,) or (r, k) [standard deviations], for given signs (S,) or (S, k) [1]."""
        return np.asarray(self.projections @ signs)

    def loss(self, signs: Array) -> float:
        """J(s) of the signs (S,) [1], at least 0 [squared standard deviations]."""
        return max(float(self.energies.sum() - np.sum(self.coordinates(signs) ** 2)), 0.0)


def build_sign_problem(
    observed: Observations, segments: Sequence[Segment], weights: Array, known: KnownRows | None = None
) -> SignProblem:
    """Problem of some segments of joints whose torque has no sign, and of the rows `known`.

    Samples near reversals are left out. A joint's torque is weighted by its weights (n,) [1/N.m or 1/N].
    """
    inside = []
    for joint, start, stop in segments:
        at = np.arange(start, stop)
        steady = at[observed.steady[at, joint]]
        inside.append(steady if len(steady) else at)
    rows = [observed.rows(s.joint, at) * weights[s.joint] for s, at in zip(segments, inside, strict=True)]
    right = [np.abs(observed.torque[at, s.joint]) * weights[s.joint] for s, at in zip(segments, inside, strict=True)]
    if known is not None and len(known.target):
        rows, right = [*rows, known.matrix], [*right, known.target]
    return eliminate(rows, right, [s.joint for s in segments] + [-1] * (len(rows) - len(segments)))


def eliminate(rows: Sequence[Array], right: Sequence[Array], joints: Sequence[int]) -> SignProblem:
    """Eliminate the base parameters from the S segments of some joints.

    Their rows Y_i are (k, b) [standard deviations per unit of base]. On the right u_i (k,) [standard deviations] are
    the absolute torque, or a known right-hand side of the last segment, whose joint then is -1.

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


def signed_rows(observed: Observations, weights: Array) -> KnownRows:
    """Rows of the joints whose torque has its sign, with weights (n,) [1/N.m or 1/N]."""
    joints = np.flatnonzero(observed.known & observed.signed).tolist()
    matrix = [observed.rows(j, observed.steady[:, j]) * weights[j] for j in joints]
    target = [observed.torque[observed.steady[:, j], j] * weights[j] for j in joints]
    nothing = np.zeros((0, observed.count))
    return KnownRows(np.concatenate([nothing, *matrix]), np.concatenate([np.zeros(0), *target]))


def known_rows(observed: Observations, weights: Array) -> KnownRows:
    """Known rows with weights (n,) [1/N.m or 1/N]: joints whose torque has its sign, and the friction prior."""
    parts = [signed_rows(observed, weights), friction_prior(observed, weights)]
    return KnownRows(np.concatenate([p.matrix for p in parts]), np.concatenate([p.target for p in parts]))


def friction_prior(observed: Observations, weights: Array, strength: float = PRIOR_STRENGTH) -> KnownRows:
    """Prior rows for offset, Coulomb and viscous friction of joints whose torque has no sign.

    A row exists for each base parameter that is one of these coefficients alone, in units of the joint's rms torque and
    velocity; with strength 1 it counts as a measurement. Rows do not grow with the weights (n,) [1/N.m or 1/N] of the
    torque, so the prior loses influence as samples gain weight; a joint of weight 0 has no prior.
    """
    torque, speed = observed.rms, np.sqrt(np.mean(observed.v**2, axis=0))
    matrix, target = [np.zeros((0, observed.count))], []
    for k, (name, joint) in observed.coefficients.items():
        used = joint in observed.hidden and weights[joint] > 0 and torque[joint] * speed[joint] > 0
        if name in FRICTION_PRIOR and used:
            expected, deviation = FRICTION_PRIOR[name]
            unit = torque[joint] / (speed[joint] if name == "viscous_friction" else 1.0)
            matrix.append(np.eye(1, observed.count, k) * strength / (deviation * unit))
            target.append(strength * expected / deviation)
    return KnownRows(np.concatenate(matrix), np.array(target))


def friction_patterns(problem: SignProblem, observed: Observations, segments: Sequence[Segment]) -> list[Array]:
    """Per joint, the signs (S,) of the mean velocity in its segments; 0 in segments of other joints [1].

    The search tries the signs of a joint as this pattern, as its opposite, and multiplied by it: Coulomb friction F
    sign(v) fits as well as a constant offset F whose sign never changes.
    """
    velocity = np.array([np.sign(observed.v[s.start : s.stop, s.joint].mean()) or 1.0 for s in segments])
    wide = np.append(velocity, np.zeros(problem.count - len(segments)))
    return [np.where(problem.joints == joint, wide, 0.0) for joint in np.unique([s.joint for s in segments])]


def orthonormalise(rows: Array) -> tuple[Array, Array]:
    """Orthonormal U (M, r) that spans the columns of the rows (M, b) [any], and back (b, r) with rows @ back = U."""
    size = np.linalg.norm(rows, axis=0)
    size[size < 1e-12 * max(float(size.max(initial=0.0)), 1e-300)] = np.inf
    q, r = np.linalg.qr(rows / size)
    left, singular, right = np.linalg.svd(r)
    rank = int(np.sum(singular > ROW_RANK_TOLERANCE * singular[0]))
    return q @ left[:, :rank], (right[:rank].T / singular[:rank]) / size[:, None]


class Certificate(NamedTuple):
    """Lower bound on the loss of all signs, and whether the given signs attain it."""

    lower: float  # [squared standard deviations]
    optimal: bool


def certify(problem: SignProblem, signs: Array) -> Certificate:
    """Lower bound on J from the eigenvalues at given signs; sufficient, but not necessary, for their optimality.

    J(x) = x'Qx with Q = diag(T) - B'B. With D = diag(s (Q s)), every x in {-1, 1}^S has x'Qx >= tr D + S min(0,
    eig_min(Q - D)), and tr D = J(s): s is optimal if Q - D has no negative eigenvalue. The signs (S,) [1] are usually a
    local minimum.

    Source: the dual of the semidefinite relaxation: Poljak, Rendl, Wolkowicz, J. Global Optimization 7, 1995.
    """
    from scipy.linalg import eigvalsh

    multipliers = problem.energies - signs * (problem.projections.T @ problem.coordinates(signs))
    slack = np.diag(problem.energies - multipliers) - problem.projections.T @ problem.projections
    smallest = float(eigvalsh(slack, subset_by_index=[0, 0], check_finite=False)[0])
    loss, short = problem.loss(signs), problem.count * max(0.0, -smallest)
    return Certificate(
        max(loss - short, 0.0), min(loss, short / problem.count) <= ENERGY_ROUNDING * float(problem.energies.sum())
    )
