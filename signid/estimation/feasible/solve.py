"""The cone's problem -> its minimiser: along the central path from the prior, or by an interior-point solver."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np

from ...deadline import seconds_left, time_is_up
from ...types import Array
from .newton import newton, polish
from .packing import BASIS
from .problem import FeasibleProblem

_SHARPEST = 1e5  # standard deviations per prior size that the interior-point solver is asked to resolve
_STRIDE = 5.0  # from one weight of the prior to the next
_FEW = 25  # steps of Newton's method that bring a stride back to the central path
_NAME = "the fit of possible inertials"
_SETTLED = 1e-6  # squared decrement of a minimiser


def solve(problem: FeasibleProblem) -> tuple[Array, str]:
    """(d,) the minimiser, and what was said of it: "optimal", or why the interior-point solver failed.

    Newton's method follows the minimiser from the prior, as a rule in less time than the interior-point solver takes to
    be imported. Where it loses the central path that solver is asked. It works best where prior and misfit are of one
    size: where it fails it is asked again with a heavier prior, and Newton's method goes on from there.
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
    """(d,) the minimiser, from the prior along the central path; None where it loses the path, or time is up.

    Args:
        problem: the problem.
        heavier: factor on the weight, with which the prior is about the minimiser.
    """
    u = problem.start
    for factor in _STRIDE ** np.arange(np.log(heavier) / np.log(_STRIDE), 0.0, -1.0):
        eased = replace(problem, weight=factor * problem.weight)
        u = polish(eased, u, steps=_FEW, precision=0.1, exact=False)
        if newton(eased, u, exact=False)[1] > 1 or time_is_up(_NAME):
            return None
    u = polish(problem, polish(problem, u, steps=_FEW, exact=False))
    return u if newton(problem, u)[1] < _SETTLED else None


def follow(problem: FeasibleProblem, u: Array, heavier: float) -> Array:
    """(d,) the minimiser by Newton's method, in small strides from a prior so much heavier to the weight asked for.

    Strides are small because Newton's method alone creeps along the cone's surface once it has left the central path.
    They end early where the misfit is so large that no lighter prior could lessen it by more than a thousandth.

    Args:
        problem: the problem.
        u: (d,) near the minimiser for the heavier prior [1].
        heavier: factor on the weight.
    """
    for factor in _STRIDE ** np.arange(np.log(heavier) / np.log(_STRIDE), 0.0, -1.0):
        u = polish(replace(problem, weight=factor * problem.weight), u, steps=100, precision=0.1)
        if factor * problem.weight * len(u) < 1e-3 * problem.distance(u) ** 2:
            return u
    return polish(problem, u)


def _ask(problem: FeasibleProblem) -> tuple[Array | None, str]:
    import cvxpy as cp  # here, because it takes longer to import than to solve

    unit = problem.weight**0.5  # so many standard deviations count as one
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
