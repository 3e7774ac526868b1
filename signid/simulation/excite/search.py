"""The search for a motion: random ones, local searches from several of them, and the best of these to its end."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...optimisers import OPTIMISERS, Optimum, Problem
from ...types import Array, Frozen, Progress
from .cost import Cost
from .motions.random_motion import fit_inside, random_parameters

SEARCH = "the search for a motion"
GRID = 0.01  # [s] on which motions are scaled to their limits
ALGORITHM = "LD_SLSQP"  # goes on at kinks (contact, reversals), where LD_LBFGS gives up
BOX = 2.5  # of z: parameters alone meet a limit at 1
SPARE = 0.02  # [m] more clearance than is needed: a search looks at few instants
FEW = 6  # joints
FIRM = 30.0  # times the penalty in the last stage


@dataclass(frozen=True)
class Budget:
    """How many motions each stage of a search may judge."""

    pool: int = 60  # random motions
    starts: int = 4  # the best of them are searched from,
    short: int = 80  # each so long;
    long: int = 500  # the best result further
    firm: int = 150  # and at last with firm limits

    @classmethod
    def usual(cls, joints: int) -> Budget:
        """About half a minute for six joints or seven: fewer joints are judged faster."""
        return cls(starts=8, long=700) if joints <= FEW else cls()

    @property
    def total(self) -> int:
        return self.pool + self.starts * self.short + self.long + self.firm


@dataclass(frozen=True, eq=False)
class Found(Frozen):
    """Parameters that a search ended with."""

    x: Array  # (n, d) [rad or m]
    evaluations: int
    spent: bool  # whether a budget ended it, before it arrived at an optimum


def search(cost: Cost, budget: Budget, seed: int, progress: Progress | None = None) -> Found:
    """The best motion found; penalties are firm at the end, so that it nearly obeys the limits.

    Local searches from the best random motions are the global stage: NLopt's GN_CRS2_LM found nothing better than the
    best of 60 random motions in 500 evaluations, in 63 dimensions.

    Args:
        cost: of a motion.
        budget: of each stage.
        seed: of random motions.
        progress: told what is being done.

    Source: multi-start as in Rinnooy Kan, Timmer, Mathematical Programming 39, 1987.
    """
    watched = _Watched(cost, budget, progress)
    rng, limits = np.random.default_rng(seed), cost.problem.limits
    fine = cost.family.basis(np.arange(0, cost.t[-1], GRID))
    pool = [np.clip(cost.relative(random_parameters(fine, limits, rng)), -BOX, BOX) for _ in range(budget.pool)]
    ranked = sorted(pool, key=watched.value)
    tried = [watched.improve(z, budget.short, "searching") for z in ranked[: budget.starts]]
    best = watched.improve(min(tried, key=lambda end: end.value).x, budget.long, "improving")
    settled = enforce_limits(cost, cost.parameters(best.x), budget, progress)
    spent = settled.spent or best.status == "budget"
    return Found(settled.x, watched.count + settled.evaluations, spent)


def enforce_limits(cost: Cost, x: Array, budget: Budget, progress: Progress | None = None) -> Found:
    """A motion moved to where it obeys firm penalties.

    Args:
        cost: of a motion.
        x: (n, d) [rad or m] its parameters.
        budget: of the stage `firm`.
        progress: told what is being done.
    """
    firm = replace(cost, penalty=FIRM * cost.penalty)
    watched = _Watched(firm, budget, progress, budget.total - budget.firm)
    best = watched.improve(np.clip(cost.relative(x), -BOX, BOX), budget.firm, "settling")
    fine = cost.family.basis(np.arange(0, cost.t[-1], GRID))
    x = fit_inside(fine, cost.problem.limits, cost.parameters(best.x))
    return Found(x, watched.count, best.status == "budget")


class _Watched:
    """A cost that tells how far the search is, and remembers its last slope."""

    def __init__(self, cost: Cost, budget: Budget, progress: Progress | None, before: int = 0) -> None:
        self.cost, self.budget, self.progress = cost, budget, progress
        self.count, self.before, self.stage = 0, before, "drawing"
        self.last: tuple[bytes, float] = b"", np.inf

    def improve(self, z: Array, evaluations: int, stage: str) -> Optimum:
        """The best point of a local search from z (d,) [1]."""
        box, self.stage, self.last = np.full(len(z), BOX), stage, (b"", np.inf)
        problem = Problem(self.value, -box, box, z, self.slope, SEARCH)
        return OPTIMISERS["nlopt"].minimise(problem, algorithm=ALGORITHM, budget_evaluations=evaluations)

    def value(self, z: Array) -> float:
        """Cost of z (d,) [1]."""
        self.count += 1
        if self.progress is not None:
            self.progress(f"{self.stage} motions", min(1.0, (self.before + self.count) / self.budget.total))
        return self.last[1] if self.last[0] == z.tobytes() else self.cost.value(z)

    def slope(self, z: Array) -> Array:
        """(d,) [1] of the cost at z (d,) [1]."""
        value, slope = self.cost.value_and_slope(z)
        self.last = z.tobytes(), value
        return slope
