"""Feasible standard parameters nearest to an estimate.

The minimiser is found by Newton's method along the central path, or by an interior-point solver.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...deadline import seconds_left, time_is_up
from ...types import Array, BaseMap, Estimate, Frozen, Parameters
from .problem import BASIS, IDENTITY, FeasibleProblem, build_problem, congruence, diagonal, feasible_prior, pack

_NEAR = 1e-3  # [standard deviations] distance from the estimate that counts as zero
_CLOSER = 0.7  # [1] largest remaining share of the distance after the prior's weight is divided by ten
_SPARE = 1e-9  # [1] margin of a pseudo-inertia over its trace, so that it stays feasible when written with nine digits
_SHARPEST = 1e5  # [standard deviations per prior size] largest singular value that the interior-point solver gets
_STRIDE = 5.0  # [1] factor between successive weights of the prior
_FEW = 25  # largest number of Newton steps per weight
_NAME = "the fit of feasible inertials"
_SETTLED = 1e-6  # [1] squared decrement at which a minimiser has converged


@dataclass(frozen=True, eq=False)
class ConsistentFit(Frozen):
    """Feasible standard parameters, and the changes of the base parameters that they need."""

    parameters: Parameters
    base_value: Array  # (b,) [unit of each] combination @ parameters
    chi2: float  # squared distance from the estimate, weighted by its information
    moves: Array  # (b,) [standard deviations of the estimate], 0 where that is infinite
    feasible_without_moving: bool  # whether the estimate itself is feasible and was kept
    notes: tuple[str, ...] = ()

    @property
    def moved(self) -> float:
        """Largest change of a base parameter [standard deviations]."""
        return float(np.abs(self.moves).max(initial=0.0))


def fit_consistent(
    base: BaseMap, estimate: Estimate, prior: Parameters, *, prior_weight: float = 1e-2
) -> ConsistentFit:
    """Fit feasible standard parameters to the estimate; the prior determines unidentifiable directions.

    Minimises ||R(K x - b)||^2 + prior_weight * sum of tr(P0^-1 P) - log det P over the pseudo-inertias P of the bodies
    that the torque depends on. R'R is the information; friction and armature are not negative. If the estimate is
    feasible, it is kept, and the prior only determines unidentifiable directions. Feasibility is verified by Cholesky
    factors, not by the solver's status; an infeasible solution is moved towards the prior until it is feasible.

    The prior is usually that of the robot description; its massless, flat and infeasible bodies are replaced, and the
    notes say so. Its weight is in squared standard deviations.

    Source: Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018 (problem); Lee, Wensing, Park, IEEE T-RO 36(1), 2020 (log det).
    """
    start, notes = feasible_prior(base, prior)
    problem = build_problem(base, estimate, start, prior_weight)
    u, status = solve(problem)
    if status not in ("optimal", "optimal_inaccurate"):
        notes += (f"the conic solver ended with {status!r}; Newton's method solved the problem instead",)
    kept = _kept(problem, u)
    parameters, share = (kept, 0.0) if kept else _verified(problem.standard(u), start)
    if share:
        notes += (f"a share of {share:.0e} of the prior was mixed in to make the parameters feasible beyond rounding",)
    value = base.combination @ parameters.values
    away = value - estimate.value
    identifiable = np.isfinite(estimate.std) & (estimate.std > 0)
    moves = np.divide(away, estimate.std, out=np.zeros_like(away), where=identifiable)
    chi2 = max(float(away @ estimate.information @ away), 0.0)
    return ConsistentFit(parameters, value, chi2, moves, kept is not None, notes)


def _kept(problem: FeasibleProblem, u: Array) -> Parameters | None:
    """Feasible parameters that reproduce the estimate, if the minimiser converges to it for a vanishing prior."""
    near = _NEAR + 1e-10 * float(np.linalg.norm(problem.target))
    for decade in range(1, 8):
        if problem.distance(u) < near:
            parameters = problem.standard(u)
            return parameters if parameters.is_feasible(_SPARE) else None
        closer = polish(replace(problem, weight=10.0**-decade * problem.weight), u, steps=25)
        if problem.distance(closer) > _CLOSER * problem.distance(u):
            return None
        u = closer
    return None


def _verified(parameters: Parameters, prior: Parameters) -> tuple[Parameters, float]:
    """Parameters with the smallest share of the prior, in quarter decades, that makes them feasible."""
    for share in (0.0, *10.0 ** np.linspace(-14, -0.25, 56)):
        mixed = replace(parameters, values=(1 - share) * parameters.values + share * prior.values)
        if mixed.is_feasible():
            return mixed, float(share)
    return prior, 1.0


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
