"""Penalty-based search for standard parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...deadline import show_step, time_is_up
from ...errors import OptionError
from ...optimisers import OPTIMISERS, Optimum
from ...types import BaseMap, Estimate, Frozen, Label, Parameters
from ..feasible.fit import information_root
from .cost import PBRP_NAME, Bounds, PenaltyCost, Physics, bounds_around, check_box, cost_over, descend, physics_of

_MAX_BOX_SHARPNESS = 1e4  # [standard deviations per width of the box] largest sharpness that the search resolves
_MAX_BOX_GAIN = 1e-2  # [squared standard deviations] predicted gain over the whole box at which a run has converged
_EXTRA_ROUNDS = 6  # largest number of additional rounds, while the result is infeasible or has not converged
_LOCAL_BUDGET = 2_000  # evaluations of a local algorithm
_LOCAL_BUDGETS = {"LN_SBPLX": 10_000, "LN_NELDERMEAD": 10_000}  # the same for algorithms that take many small steps


@dataclass(frozen=True)
class SearchRun:
    """Result of one start of the search."""

    cost: float  # chi2 with limited sharpness, plus the last penalty
    chi2: float  # squared distance from the estimate, weighted by its information
    violation: float  # violation of physics; 0 without any
    weight: float  # [squared standard deviations] weight of the last penalty
    feasible: bool  # by Cholesky factors of the pseudo-inertias
    converged: bool  # by the gradient
    evaluations: int


@dataclass(frozen=True, eq=False)
class Retrieval(Frozen):
    """Best run, and all runs."""

    parameters: Parameters
    best: SearchRun
    runs: tuple[SearchRun, ...]
    global_algorithm: str
    local_algorithm: str
    seed: int
    notes: tuple[str, ...] = ()


def retrieve(
    base: BaseMap,
    estimate: Estimate,
    prior: Parameters,
    bounds: Bounds | None = None,
    *,
    global_algorithm: str = "GN_CRS2_LM",
    local_algorithm: str = "LD_LBFGS",
    runs: int = 3,
    rounds: int = 10,
    schedule: float = 10.0,
    seed: int = 0,
    total_mass: tuple[float, float] | None = None,
    budget_global: int = 10_000,
    budget_local: int | None = None,
) -> Retrieval:
    """Search a box for standard parameters that reproduce the base parameters and obey physics.

    Each run starts at a random point of the box. Its first round fits only the base parameters, by a global and then a
    local algorithm. Each later round starts from the last one and adds a heavier penalty, `schedule` times its number,
    on violations of physics. Up to six rounds follow: with a tenfold penalty while the result is infeasible, with the
    same one while it has not converged. Algorithms with gradients (LD_) are suitable for up to 7 joints with friction,
    those without (LN_) for up to about 30 parameters. The search stays within its budget and notes how it ended.

    The prior gives only the sizes and the default box. The `schedule` is in squared standard deviations, the range of
    the total mass of all moving bodies in kg. Budgets are evaluations: of the global algorithm per run, of the local
    algorithm per round (default: 2 000, or 10 000 for those that take many small steps).

    Raises:
        OptionError: an algorithm does not exist, or runs, rounds, bounds or the range of mass are invalid.

    Source: Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca, IEEE RA-L 4(4), 2019, Algorithm 1.
    """
    if runs < 1 or rounds < 1:
        raise OptionError(f"runs is {runs} and rounds is {rounds}; give at least 1 of each")
    box = bounds_around(base, estimate, prior) if bounds is None else bounds
    cost = cost_of(base, estimate, box, physics_of(base, estimate, prior, total_mass))
    budget_local = budget_local or _LOCAL_BUDGETS.get(local_algorithm, _LOCAL_BUDGET)
    rng, found = np.random.default_rng(seed), list[_SearchResult]()
    for name in (global_algorithm, local_algorithm):
        OPTIMISERS["nlopt"].chosen(cost.problem(np.zeros(len(cost.free)), 0.0), name)
    weights = (schedule * np.arange(rounds)).tolist()
    for k in range(runs):
        show_step("searching standard parameters", k / runs)
        first = descend(cost, rng.uniform(size=len(cost.free)), [0.0], global_algorithm, budget_global, seed + k)
        show_step("searching standard parameters", (k + 1 / 3) / runs)
        ends = [first, descend(cost, first.x, weights, local_algorithm, budget_local, seed + k)]
        run = _judge_run(base, estimate, cost, weights[-1], ends)
        while not (run.feasible and run.converged) and len(ends) < 2 + _EXTRA_ROUNDS and not time_is_up(PBRP_NAME):
            weight = run.weight if run.feasible else 10 * max(run.weight, schedule)
            ends.append(descend(cost, ends[-1].x, [weight], local_algorithm, budget_local, seed + k))
            run = _judge_run(base, estimate, cost, weight, ends)
        found.append(_SearchResult(run, ends))
        if time_is_up(PBRP_NAME):
            break
    best = min(found, key=lambda f: (not f.run.feasible, f.run.cost))
    parameters = Parameters(base.labels, cost.standard(best.ends[-1].x))
    table, notes = tuple(f.run for f in found), _search_notes(best, cost, base.labels)
    return Retrieval(parameters, best.run, table, global_algorithm, local_algorithm, seed, notes)


class _SearchResult(NamedTuple):
    run: SearchRun
    ends: list[Optimum]  # of the global algorithm, of the regular rounds, of each additional round


def cost_of(base: BaseMap, estimate: Estimate, box: Bounds, physics: Physics) -> PenaltyCost:
    """Cost of a search: squared distance from an estimate with limited sharpness, plus the penalty."""
    check_box(box, base)
    root, width = information_root(estimate.information), box.upper - box.lower
    left, sharpness, right = np.linalg.svd(root @ base.combination * width, full_matrices=False)
    eased = np.minimum(1.0, _MAX_BOX_SHARPNESS / np.maximum(sharpness, 1e-300))
    rotated = (eased[:, None] * left.T) @ root
    return cost_over(box, physics, rotated @ base.combination, rotated @ estimate.value)


def _judge_run(base: BaseMap, estimate: Estimate, cost: PenaltyCost, weight: float, ends: list[Optimum]) -> SearchRun:
    """Result of a run, with feasibility and convergence tested independently of NLopt's status."""
    z = ends[-1].x
    x, last = cost.standard(z), cost.problem(z, weight)
    assert last.gradient is not None, "a cost has one"
    away, slope, value = base.combination @ x - estimate.value, last.gradient(z), last.objective(z)
    in_sight = float(np.max(np.abs(slope) * np.where(slope > 0, z, 1 - z), initial=0.0))
    return SearchRun(
        cost=value,
        chi2=max(float(away @ estimate.information @ away), 0.0),
        violation=cost.physics.excess(x),
        feasible=Parameters(base.labels, x).is_feasible(),
        weight=weight,
        converged=in_sight <= _MAX_BOX_GAIN + 1e-6 * value,
        evaluations=sum(end.evaluations for end in ends),
    )


def _search_notes(found: _SearchResult, cost: PenaltyCost, labels: tuple[Label, ...]) -> tuple[str, ...]:
    run, ends = found
    at_edge = (ends[-1].x == 1.0) | ((ends[-1].x == 0.0) & ~np.isin(cost.free, cost.physics.positive))
    edge = [labels[i].name for i in cost.free[at_edge]]
    failed = dict.fromkeys(end.algorithm for end in ends[: 1 if run.converged else None] if end.status == "failed")
    notes = [f"NLopt's {name} failed on this problem; the search continued from its last point" for name in failed]
    if not run.converged:
        spent = f"the search did not converge within {run.evaluations} evaluations"
        notes.append(f"{spent}; try another --local-algorithm, or --method convex")
    if not run.feasible:
        notes.append("the parameters are infeasible: the search found no feasible ones in the box; widen it")
    if edge:
        more = " ..." if len(edge) > 5 else ""
        notes.append(f"parameters at a bound of the box, which may be too narrow: {', '.join(edge[:5])}{more}")
    return tuple(notes)
