"""Feasible standard parameters nearest to an estimate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...types import Array, BaseMap, Estimate, Frozen, Parameters
from .prior import feasible_prior
from .problem import FeasibleProblem, build_problem
from .solve import polish, solve

_NEAR = 1e-3  # [standard deviations] distance from the estimate that counts as zero
_CLOSER = 0.7  # [1] largest remaining share of the distance after the prior's weight is divided by ten
_SPARE = 1e-9  # [1] margin of a pseudo-inertia over its trace, so that it stays feasible when written with nine digits


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

    Args:
        base: base map.
        estimate: base parameters and their information.
        prior: standard parameters with the labels of `base`, usually those of the robot description; massless, flat and
            infeasible bodies are replaced, and the notes say so.
        prior_weight: weight of the prior [squared standard deviations].

    Raises:
        ValueError: the prior does not have the labels of the base map.

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
