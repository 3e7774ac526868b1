"""Segments -> the order in which a tree of signs meets them."""

from __future__ import annotations

import numpy as np

from ..types import Array, Indices
from .problem import Problem


def branching_order(problem: Problem, z: Array) -> Indices:
    """The segments (S,), a known one first, then those that matter much and are uncertain.

    |b_i| is what a sign can do, |b_i| / |b_i'z| how easily it turns round where the parameters are about z. What comes
    late in a tree is what its bounds may then take as good as known.

    Args:
        problem: the boolean least squares.
        z: (r,) good coordinates [standard deviations].
    """
    size = np.linalg.norm(problem.projections, axis=0)
    clear = np.abs(problem.projections.T @ z)
    score = size**3 / np.maximum(clear, 1e-12 * np.max(size, initial=1e-300) ** 2)
    if problem.anchored:
        score[-1] = np.inf
    return np.argsort(-score, kind="stable")
