"""The penalty-based search itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...deadline import show_step, time_is_up
from ...errors import OptionError
from ...optimisers import OPTIMISERS, Optimum
from ...types import BaseMap, Estimate, Frozen, Label, Parameters
from ..feasible.problem import information_root
from .bounds import Bounds, bounds_around, check_box
from .cost import SEARCH, Cost, cost_over, descend
from .penalty import Physics, physics_of

_SHARPEST = 1e4  # standard deviations per width of the box that the search is asked to resolve
_SETTLED = 1e-2  # gain still in sight over the whole box, in squared standard deviations, at which a run has converged
_MORE = 6  # rounds that may follow, as long as the result is still impossible or has not settled
_BUDGET = 2_000  # evaluations of a local algorithm, but:
_BUDGETS = {"LN_SBPLX": 10_000, "LN_NELDERMEAD": 10_000}


@dataclass(frozen=True)
class Run:
    """One start of the search and where it ended, judged by the pseudo-inertia test and the gradient."""

    cost: float  # chi2, with what is known very sharply eased, plus the last penalty
    chi2: float  # squared distance from the estimate, in its own information
    violation: float  # of physics, 0 where there is none
    weight: float  # of the last penalty [squared standard deviations]
    feasible: bool
    converged: bool
    evaluations: int


@dataclass(frozen=True, eq=False)
class Retrieval(Frozen):
    """The best of the runs."""

    parameters: Parameters
    best: Run
    runs: tuple[Run, ...]
    global_algorithm: str
    local_algorithm: str
    seed: int
    notes: tuple[str, ...] = ()

    @property
    def cost(self) -> float:
        """Distance from the estimate, with what is known very sharply eased, plus the last penalty."""
        return self.best.cost

    @property
    def chi2(self) -> float:
        """Squared distance from the estimate, in its own information."""
        return self.best.chi2

    @property
    def violation(self) -> float:
        """Of physics, 0 where there is none."""
        return self.best.violation

    @property
    def feasible(self) -> bool:
        """Whether a real robot could have the parameters; proved by Cholesky factors."""
        return self.best.feasible

    @property
    def converged(self) -> bool:
        """Whether no direction in the box promises a better cost."""
        return self.best.converged


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
    """Standard parameters in a box that reproduce the base parameters and obey physics, as far as a search finds them.

    Each run starts anywhere in the box. Its first round asks only for the base parameters, by a global and then a local
    algorithm; each later round starts from the last and adds a heavier penalty, `schedule` times its number, on what
    violates physics. Up to six more rounds follow: of a tenfold penalty while the last is still impossible, of the same
    one while it has not settled. With gradients (LD_) good up to 7 joints with friction; without (LN_) up to some 30
    parameters: it stays within its budget and says how it ended.

    Args:
        base: which combinations of the standard parameters the torque shows.
        estimate: base parameters and their information.
        prior: standard parameters of the description; they give the box and the sizes, not the answer.
        bounds: the box; around the prior by default.
        global_algorithm: of NLopt, for the first round.
        local_algorithm: of NLopt, for every round.
        runs: starts, of which the best is kept.
        rounds: of growing penalty.
        schedule: penalty per round, in squared standard deviations.
        seed: of the starts and of the global algorithm.
        total_mass: least and largest sum of the masses of all moving bodies [kg].
        budget_global: evaluations per run of the global algorithm.
        budget_local: evaluations per round of the local algorithm; by default 2 000, or 10 000 of those that take many
            small steps.

    Raises:
        OptionError: when an algorithm does not exist, or runs, rounds, bounds or the range of mass make no sense.
        ValueError: when the prior does not have the labels of the base map.

    Source: Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca, IEEE RA-L 4(4), 2019, Algorithm 1.
    """
    if runs < 1 or rounds < 1:
        raise OptionError(f"{runs} runs of {rounds} rounds were asked for; ask for at least 1 of each")
    box = bounds_around(base, estimate, prior) if bounds is None else bounds
    cost = cost_of(base, estimate, box, physics_of(base, estimate, prior, total_mass))
    budget_local = budget_local or _BUDGETS.get(local_algorithm, _BUDGET)
    rng, found = np.random.default_rng(seed), list[_Found]()
    for name in (global_algorithm, local_algorithm):
        OPTIMISERS["nlopt"].chosen(cost.problem(np.zeros(len(cost.free)), 0.0), name)
    weights = (schedule * np.arange(rounds)).tolist()
    for k in range(runs):
        show_step("searching standard parameters", k / runs)
        first = descend(cost, rng.uniform(size=len(cost.free)), [0.0], global_algorithm, budget_global, seed + k)
        show_step("searching standard parameters", (k + 1 / 3) / runs)
        ends = [first, descend(cost, first.x, weights, local_algorithm, budget_local, seed + k)]
        run = _judge(base, estimate, cost, weights[-1], ends)
        while not (run.feasible and run.converged) and len(ends) < 2 + _MORE and not time_is_up(SEARCH):
            weight = run.weight if run.feasible else 10 * max(run.weight, schedule)
            ends.append(descend(cost, ends[-1].x, [weight], local_algorithm, budget_local, seed + k))
            run = _judge(base, estimate, cost, weight, ends)
        found.append(_Found(run, ends))
        if time_is_up(SEARCH):
            break
    best = min(found, key=lambda f: (not f.run.feasible, f.run.cost))
    parameters = Parameters(base.labels, cost.standard(best.ends[-1].x))
    table, notes = tuple(f.run for f in found), _notes(best, cost, base.labels)
    return Retrieval(parameters, best.run, table, global_algorithm, local_algorithm, seed, notes)


class _Found(NamedTuple):
    run: Run
    ends: list[Optimum]  # of the global algorithm, of the rounds that were asked for, of each that was added


def cost_of(base: BaseMap, estimate: Estimate, box: Bounds, physics: Physics) -> Cost:
    """Squared distance from an estimate, with what is known very sharply eased, plus the penalty.

    Args:
        base: which combinations of the standard parameters the torque shows.
        estimate: base parameters and their information.
        box: of the standard parameters.
        physics: what they obey.

    Raises:
        OptionError: the box is over other parameters.
    """
    check_box(box, base)
    root, width = information_root(estimate.information), box.upper - box.lower
    left, sharpness, right = np.linalg.svd(root @ base.combination * width, full_matrices=False)
    eased = np.minimum(1.0, _SHARPEST / np.maximum(sharpness, 1e-300))
    rotated = (eased[:, None] * left.T) @ root
    return cost_over(box, physics, rotated @ base.combination, rotated @ estimate.value)


def _judge(base: BaseMap, estimate: Estimate, cost: Cost, weight: float, ends: list[Optimum]) -> Run:
    """What came out, by tests of our own."""
    z = ends[-1].x
    x, last = cost.standard(z), cost.problem(z, weight)
    assert last.gradient is not None, "a cost has one"
    away, slope, value = base.combination @ x - estimate.value, last.gradient(z), last.objective(z)
    in_sight = float(np.max(np.abs(slope) * np.where(slope > 0, z, 1 - z), initial=0.0))
    return Run(
        cost=value,
        chi2=max(float(away @ estimate.information @ away), 0.0),
        violation=cost.physics.excess(x),
        feasible=Parameters(base.labels, x).is_feasible(),
        weight=weight,
        converged=in_sight <= _SETTLED + 1e-6 * value,
        evaluations=sum(end.evaluations for end in ends),
    )


def _notes(found: _Found, cost: Cost, labels: tuple[Label, ...]) -> tuple[str, ...]:
    run, ends = found
    at_edge = (ends[-1].x == 1.0) | ((ends[-1].x == 0.0) & ~np.isin(cost.free, cost.physics.positive))
    edge = [labels[i].name for i in cost.free[at_edge]]
    notes = [
        f"{name} of NLopt gave up on this problem; the search went on from where it had come to"
        for name in dict.fromkeys(
            end.algorithm for end in ends[: 1 if run.converged else None] if end.status == "failed"
        )
    ]
    if not run.converged:
        spent = f"the search did not converge within {run.evaluations} evaluations"
        notes.append(f"{spent}; try another --local-algorithm, or --method convex")
    if not run.feasible:
        notes.append("no real robot could have these parameters: the search found none in the box that one could")
    if edge:
        more = " ..." if len(edge) > 5 else ""
        notes.append(f"on an edge of the box, which may be too narrow: {', '.join(edge[:5])}{more}")
    return tuple(notes)
