"""The search for a motion: random motions, a global search among them, then a local one with slopes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..optimisers import OPTIMISERS, Problem
from ..types import Array, Frozen
from .cost import Cost
from .draw import fit_inside, random_parameters

GRID = 0.01  # [s] on which motions are scaled to their limits
POOL = 60  # random motions that the search begins with
GLOBAL, LOCAL = "GN_CRS2_LM", "LD_LBFGS"
BOX = 2.5  # of z: parameters alone meet a limit at 1
FIRM = 30.0  # times the penalty in the last stage

Progress = Callable[[str, float], None]  # what is being done, share of it that is done


@dataclass(frozen=True, eq=False)
class Found(Frozen):
    """Parameters that a search ended with."""

    x: Array  # (n, d) [rad or m]
    cost: float
    evaluations: int


@dataclass(frozen=True)
class Budget:
    """Evaluations of each stage."""

    wide: int = 1000
    local: int = 250
    firm: int = 150


def search(cost: Cost, budget: Budget, seed: int, progress: Progress | None = None) -> Found:
    """The best motion found; penalties are firm at the end, so that it nearly obeys the limits.

    Args:
        cost: of a motion.
        budget: evaluations of each stage.
        seed: of random motions and of the global search.
        progress: told what is being done.
    """
    tell, nlopt = progress or (lambda what, share: None), OPTIMISERS["nlopt"]
    rng, limits = np.random.default_rng(seed), cost.setting.limits
    fine = cost.family.basis(np.arange(0, cost.t[-1], GRID))
    starts = [cost.relative(random_parameters(fine, limits, rng)) for _ in range(POOL)]
    start = np.clip(min(starts, key=cost.value), -BOX, BOX)
    box = np.full(len(start), BOX)
    used = POOL
    if budget.wide:
        watched = _Watched(cost, budget.wide, lambda share: tell("searching widely", share))
        problem = Problem(watched.value, -box, box, start)
        wide = nlopt.minimise(problem, algorithm=GLOBAL, budget_evaluations=budget.wide, seed=seed)
        start, used = wide.x, used + wide.evaluations
    for stage, evaluations, firmness in (("improving", budget.local, 1.0), ("settling", budget.firm, FIRM)):
        firm = replace(cost, penalty=firmness * cost.penalty)
        watched = _Watched(firm, evaluations, lambda share, stage=stage: tell(stage, share))  # type: ignore[misc]
        problem = Problem(watched.value, -box, box, start, watched.slope)
        best = nlopt.minimise(problem, algorithm=LOCAL, budget_evaluations=evaluations, seed=seed)
        start, used = best.x, used + best.evaluations
    return Found(fit_inside(fine, limits, cost.parameters(start)), best.value, used)


class _Watched:
    """A cost that tells how far the search is, and remembers its last slope."""

    def __init__(self, cost: Cost, budget: int, tell: Callable[[float], None]) -> None:
        self.cost, self.budget, self.tell, self.count = cost, budget, tell, 0
        self.last: tuple[bytes, tuple[float, Array]] = (b"", (np.inf, np.zeros(0)))

    def value(self, z: Array) -> float:
        """Cost of z (d,) [1]."""
        self.count += 1
        self.tell(min(1.0, self.count / self.budget))
        return self.last[1][0] if self.last[0] == z.tobytes() else self.cost.value(z)

    def slope(self, z: Array) -> Array:
        """(d,) [1] of the cost at z (d,) [1]."""
        self.last = z.tobytes(), self.cost.value_and_slope(z)
        return self.last[1][1]
