"""Certificate of global optimality: a lower bound on the loss of all signs, by eigenvalues alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...types import Array
from .problem import SignProblem

SLACK = 1e-12  # [total energy] negative eigenvalues or losses of this size are rounding errors


class Certificate(NamedTuple):
    """Lower bound on the loss of all signs, and whether the given signs attain it."""

    lower: float  # [squared standard deviations]
    optimal: bool


def certify(problem: SignProblem, signs: Array) -> Certificate:
    """Lower bound on J from the eigenvalues at given signs; sufficient, but not necessary, for their optimality.

    J(x) = x'Qx with Q = diag(T) - B'B. With D = diag(s (Q s)), every x in {-1, 1}^S has
    x'Qx >= tr D + S min(0, eig_min(Q - D)), and tr D = J(s): s is optimal if Q - D has no negative eigenvalue.

    Args:
        problem: boolean least squares.
        signs: (S,) s [1], usually a local minimum.

    Source: the dual of the semidefinite relaxation: Poljak, Rendl, Wolkowicz, J. Global Optimization 7, 1995.
    """
    from scipy.linalg import eigvalsh

    multipliers = problem.energies - signs * (problem.projections.T @ problem.coordinates(signs))
    slack = np.diag(problem.energies - multipliers) - problem.projections.T @ problem.projections
    smallest = float(eigvalsh(slack, subset_by_index=[0, 0], check_finite=False)[0])
    loss, short = problem.loss(signs), problem.count * max(0.0, -smallest)
    return Certificate(
        max(loss - short, 0.0), min(loss, short / problem.count) <= SLACK * float(problem.energies.sum())
    )
