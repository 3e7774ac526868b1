"""The feasible standard parameters nearest to an estimate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...types import Array, BaseMap, Estimate, Frozen, Parameters
from .newton import polish
from .prior import feasible_prior
from .problem import FeasibleProblem, build_problem
from .solve import solve

_NEAR = 1e-3  # standard deviations from the estimate that count as the estimate itself
_CLOSER = 0.7  # share of its distance that must be left at most when the prior is a tenth
_SPARE = 1e-9  # share of its trace that a pseudo-inertia has to spare, to outlive being written with nine digits


@dataclass(frozen=True, eq=False)
class ConsistentFit(Frozen):
    """Feasible standard parameters, and how far the base parameters had to move for them."""

    parameters: Parameters
    base_value: Array  # (b,) [unit of each] combination @ parameters
    chi2: float  # squared distance from the estimate, in its own information
    moves: Array  # (b,) [standard deviations of the estimate], 0 where that is infinite
    feasible_without_moving: bool  # a real robot like the prior could have the estimate as it stands: it was kept
    notes: tuple[str, ...] = ()

    @property
    def moved(self) -> float:
        """Largest move of a base parameter, in standard deviations."""
        return float(np.abs(self.moves).max(initial=0.0))


def fit_consistent(
    base: BaseMap, estimate: Estimate, prior: Parameters, *, prior_weight: float = 1e-2
) -> ConsistentFit:
    """The feasible standard parameters nearest to the estimate, held by the prior where torque tells nothing.

    Minimises ||R(K x - b)||^2 + prior_weight * sum of tr(P0^-1 P) - log det P over the pseudo-inertias P of the bodies
    that torque shows, R'R the information, with friction and armature not negative. Where a real robot could have the
    estimate as it stands, it is kept, and the prior decides only what torque cannot tell. The answer is proved by
    Cholesky factors, not by the solver's word; one that fails is drawn towards the prior until it passes.

    Args:
        base: which combinations of the standard parameters the torque shows.
        estimate: base parameters and their information.
        prior: standard parameters with the labels of `base`, as a rule those of the robot description; massless, flat
            and impossible bodies are replaced, and the notes say so.
        prior_weight: weight of the prior [squared standard deviations].

    Raises:
        ValueError: when the prior does not have the labels of the base map.

    Source: Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018 (problem); Lee, Wensing, Park, IEEE T-RO 36(1), 2020 (log det).
    """
    start, notes = feasible_prior(base, prior)
    problem = build_problem(base, estimate, start, prior_weight)
    u, status = solve(problem)
    if status not in ("optimal", "optimal_inaccurate"):
        notes += (f"the cone solver ended with {status!r}; Newton's method solved the problem in its stead",)
    kept = _kept(problem, u)
    parameters, share = (kept, 0.0) if kept else _proved(problem.standard(u), start)
    if share:
        notes += (f"a share of {share:.0e} of the prior was mixed in, so that the answer is feasible beyond rounding",)
    value = base.combination @ parameters.values
    away = value - estimate.value
    told = np.isfinite(estimate.std) & (estimate.std > 0)
    moves = np.divide(away, estimate.std, out=np.zeros_like(away), where=told)
    chi2 = max(float(away @ estimate.information @ away), 0.0)
    return ConsistentFit(parameters, value, chi2, moves, kept is not None, notes)


def _kept(problem: FeasibleProblem, u: Array) -> Parameters | None:
    """Feasible parameters that reproduce the estimate, if the minimiser comes to them as the prior fades."""
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


def _proved(parameters: Parameters, prior: Parameters) -> tuple[Parameters, float]:
    """The parameters with the smallest share of the prior, in quarter decades, that makes them feasible."""
    for share in (0.0, *10.0 ** np.linspace(-14, -0.25, 56)):
        mixed = replace(parameters, values=(1 - share) * parameters.values + share * prior.values)
        if mixed.is_feasible():
            return mixed, float(share)
    return prior, 1.0
