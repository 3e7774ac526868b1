"""Signs -> a lower bound of the loss of all signs, by eigenvalues alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...types import Array
from .problem import SignProblem

SLACK = 1e-12  # share of the total energy that is rounding error


class Certificate(NamedTuple):
    """What eigenvalues say about signs."""

    lower: float  # no signs have a lower loss [squared standard deviations]
    optimal: bool  # these signs have the lowest


def certify(problem: SignProblem, signs: Array) -> Certificate:
    """Whether signs are globally optimal, where eigenvalues can tell; a lower bound in any case.

    With Q = diag(T) - B'B and D = diag(s (Q s)), every x in {-1, 1}^S has x'Qx >= tr D + S min(0, eig_min(Q - D)), and
    tr D = J(s): signs are optimal where Q - D has no negative eigenvalue.

    Args:
        problem: the boolean least squares.
        signs: (S,) [1], best those of a climb.

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
