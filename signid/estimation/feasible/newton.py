"""Newton's method for the feasible fit."""

from __future__ import annotations

import numpy as np

from ...types import Array
from .packing import IDENTITY, cholesky, congruence, diagonal, pack
from .problem import FeasibleProblem


def polish(problem: FeasibleProblem, u: Array, steps: int = 30, precision: float = 1e-9, exact: bool = True) -> Array:
    """Minimiser (d,) by Newton's method with step halving.

    Args:
        problem: convex problem.
        u: (d,) strictly feasible starting point [1].
        steps: largest number of steps.
        precision: gain of a step, as a share of the weight, below which the iteration ends.
        exact: argument of `newton`.
    """
    cost = problem.cost(u)
    for _ in range(steps):
        step, _ = newton(problem, u, exact)
        trials = (u + step * 0.5**k for k in range(30))
        better = next((trial for trial in trials if problem.cost(trial) < cost), None)
        if better is None:
            return u
        gain, u = cost - problem.cost(better), better
        cost -= gain
        if gain < precision * problem.weight:
            return u
    return u


def newton(problem: FeasibleProblem, u: Array, exact: bool = True) -> tuple[Array, float]:
    """Newton step (d,), and the squared decrement: about twice the remaining gain, as a share of the weight.

    In coordinates in which the Hessian of the prior's penalty is the identity, the step is a ridge regression.

    Args:
        problem: convex problem.
        u: (d,) strictly feasible point [1].
        exact: solve by singular values; else by normal equations, which are several times faster and less accurate.
    """
    bodies, sizes, rest = problem.parts(u)
    factors = cholesky(bodies)
    metric = diagonal(congruence(factors), np.r_[sizes, np.ones(len(rest))])
    wish = np.r_[(IDENTITY - pack(np.swapaxes(factors, 1, 2) @ factors)).ravel(), 1 - sizes, -rest]
    matrix, off = problem.matrix @ metric, problem.target - problem.matrix @ u
    gap = off - matrix @ wish
    if exact:
        left, s, right = np.linalg.svd(matrix, full_matrices=False)
        further = right.T @ (s / (s**2 + problem.weight / 2) * (left.T @ gap))
    else:
        normal = matrix @ matrix.T + problem.weight / 2 * np.eye(len(gap))
        further = matrix.T @ np.linalg.solve(normal, gap)
    step = wish + further
    return metric @ step, float(2 * off @ (matrix @ step) / problem.weight + wish @ step)
