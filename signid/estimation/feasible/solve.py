"""Minimiser of the feasible fit: by Newton's method along the central path, or by an interior-point solver."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...deadline import seconds_left, time_is_up
from ...types import Array
from .packing import BASIS, IDENTITY, congruence, diagonal, pack
from .problem import FeasibleProblem

_SHARPEST = 1e5  # [standard deviations per prior size] largest singular value that the interior-point solver gets
_STRIDE = 5.0  # [1] factor between successive weights of the prior
_FEW = 25  # largest number of Newton steps per weight
_NAME = "the fit of feasible inertials"
_SETTLED = 1e-6  # [1] squared decrement at which a minimiser has converged


def solve(problem: FeasibleProblem) -> tuple[Array, str]:
    """Minimiser (d,) and its status: "optimal", or the reason why the interior-point solver failed.

    Newton's method follows the central path from the prior, usually in less time than the import of the interior-point
    solver takes. If it loses the path, that solver is used. It works best if prior and misfit are of similar size; if
    it fails, it is used again with a heavier prior, and Newton's method continues from there.
    """
    heaviest = max(problem.distance(problem.start) ** 2 / problem.weight, 1.0)
    u = trace(problem, heaviest)
    if u is not None:
        return u, "optimal"
    for heavier in (1.0, 1e4, 1e8):
        u, status = _ask(replace(problem, weight=heavier * problem.weight))
        if u is not None:
            return follow(problem, u, heavier), status
        if time_is_up(_NAME):
            break
    return follow(problem, problem.start, heaviest), status


def trace(problem: FeasibleProblem, heavier: float) -> Array | None:
    """Minimiser (d,) by the central path from the prior; None if the path is lost or time is up.

    The prior is nearly the minimiser if its weight is `heavier` times that of the problem.
    """
    u = problem.start
    for eased in _eased(problem, heavier):
        u = polish(eased, u, steps=_FEW, precision=0.1, exact=False)
        if _newton(eased, u, exact=False)[1] > 1 or time_is_up(_NAME):
            return None
    u = polish(problem, polish(problem, u, steps=_FEW, exact=False))
    return u if _newton(problem, u)[1] < _SETTLED else None


def follow(problem: FeasibleProblem, u: Array, heavier: float) -> Array:
    """Minimiser (d,) by Newton's method, while the weight of the prior decreases in small strides.

    The initial u (d,) [1] is near the minimiser for a weight `heavier` times that of the problem. Strides are small
    because Newton's method is slow near the boundary of the feasible set. They end early if the misfit is so large that
    a lighter prior could reduce it by a thousandth at most.
    """
    for eased in _eased(problem, heavier):
        u = polish(eased, u, steps=100, precision=0.1)
        if eased.weight * len(u) < 1e-3 * problem.distance(u) ** 2:
            return u
    return polish(problem, u)


def _eased(problem: FeasibleProblem, heavier: float) -> Iterator[FeasibleProblem]:
    """Problems with successively lighter priors."""
    for factor in _STRIDE ** np.arange(np.log(heavier) / np.log(_STRIDE), 0.0, -1.0):
        yield replace(problem, weight=factor * problem.weight)


def polish(problem: FeasibleProblem, u: Array, steps: int = 30, precision: float = 1e-9, exact: bool = True) -> Array:
    """Minimiser (d,) by Newton's method with step halving, from a strictly feasible u (d,) [1].

    The iteration ends when a step gains less than `precision`, a share of the weight.
    """
    cost = problem.cost(u)
    for _ in range(steps):
        step, _ = _newton(problem, u, exact)
        trials = (u + step * 0.5**k for k in range(30))
        better = next((trial for trial in trials if problem.cost(trial) < cost), None)
        if better is None:
            return u
        gain, u = cost - problem.cost(better), better
        cost -= gain
        if gain < precision * problem.weight:
            return u
    return u


def _newton(problem: FeasibleProblem, u: Array, exact: bool = True) -> tuple[Array, float]:
    """Newton step (d,), and the squared decrement: about twice the remaining gain, as a share of the weight."""
    # In coordinates in which the Hessian of the prior's penalty is the identity, the step is a ridge regression.
    bodies, sizes, rest = problem.parts(u)
    factors = np.asarray(np.linalg.cholesky(bodies), dtype=np.float64)
    metric = diagonal(congruence(factors), np.r_[sizes, np.ones(len(rest))])
    wish = np.r_[(IDENTITY - pack(np.swapaxes(factors, 1, 2) @ factors)).ravel(), 1 - sizes, -rest]
    matrix, off = problem.matrix @ metric, problem.target - problem.matrix @ u
    gap = off - matrix @ wish
    if exact:
        left, s, right = np.linalg.svd(matrix, full_matrices=False)
        further = right.T @ (s / (s**2 + problem.weight / 2) * (left.T @ gap))
    else:  # normal equations are several times faster and less accurate
        normal = matrix @ matrix.T + problem.weight / 2 * np.eye(len(gap))
        further = matrix.T @ np.linalg.solve(normal, gap)
    step = wish + further
    return metric @ step, float(2 * off @ (matrix @ step) / problem.weight + wish @ step)


def _ask(problem: FeasibleProblem) -> tuple[Array | None, str]:
    import cvxpy as cp  # its import takes longer than the solution by Newton's method

    unit = problem.weight**0.5  # [standard deviations] unit of residuals
    left, sharpness, right = np.linalg.svd(problem.matrix / unit, full_matrices=False)
    eased = np.minimum(1.0, _SHARPEST / np.maximum(sharpness, 1e-300))
    u = cp.Variable(len(problem.offset))
    rows = (eased * sharpness)[:, None] * right @ u - eased * (left.T @ problem.target) / unit
    (one, two), spread = problem.bounds, BASIS.reshape(10, 16).T
    bodies = [cp.reshape(spread @ u[i : i + 10], (4, 4), order="C") for i in range(0, one, 10)]
    barrier = sum((cp.trace(s) - cp.log_det(s) for s in bodies), cp.sum_squares(u[two:]) / 2)
    barrier += cp.sum(u[one:two] - cp.log(u[one:two]))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            program = cp.Problem(cp.Minimize(cp.sum_squares(rows) + barrier))
            program.solve(solver=cp.CLARABEL, time_limit=seconds_left())
    except cp.error.SolverError:
        return None, "failed"
    if u.value is None or not np.isfinite(problem.cost(u.value)):
        return None, f"{program.status} without a feasible point"
    return u.value, str(program.status)
