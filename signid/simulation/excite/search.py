"""Search for a motion, and its scale at which it obeys all limits.

The search evaluates random motions, and improves the best of them by local searches and the best result by a long one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...errors import OptionError
from ...optimisers import OPTIMISERS, Optimum, Problem
from ...types import Array, Frozen, Progress
from .cost import ExcitationCost
from .families import Family, steady
from .problem import ExcitationProblem
from .random_motions import fit_inside, random_parameters

SEARCH = "the search for a motion"
GRID = 0.01  # [s] grid on which motions are scaled to their limits
ALGORITHM = "LD_SLSQP"  # continues at kinks of the cost (contact, reversals), where LD_LBFGS fails
BOX = 2.5  # [1] bound of z; a parameter alone meets a limit at 1
SPARE = 0.02  # [m] extra clearance, since the search uses few samples
FEW = 6  # joints up to which the default budget is larger
FIRM = 30.0  # [1] factor on the penalty in the last stage
FINE = 1e-3  # [s] grid on which limits are checked
NEAR = 5e-3  # [s] grid on which distances between links are checked
COARSE = 100  # [multiples of FINE] grid of a first check of these distances
HALVINGS = 8  # bisection steps of the scale of the motion
SLACK = 1e-9  # [1] rounding of a share of a limit


@dataclass(frozen=True)
class Budget:
    """Evaluations of each stage of a search."""

    pool: int = 60  # random motions
    starts: int = 4  # local searches from the best of these
    short: int = 80  # evaluations of each of them
    long: int = 500  # evaluations of the search from the best result
    firm: int = 150  # evaluations of the last stage, with firm limits

    @classmethod
    def usual(cls, joints: int) -> Budget:
        """Default budget for a number of joints: about half a minute for six or seven."""
        return cls(starts=8, long=700) if joints <= FEW else cls()

    @property
    def total(self) -> int:
        return self.pool + self.starts * self.short + self.long + self.firm


@dataclass(frozen=True, eq=False)
class FoundMotion(Frozen):
    """Result of a search."""

    x: Array  # (n, d) [rad or m] parameters
    evaluations: int
    spent: bool  # whether the budget ended the search before an optimum


def search(cost: ExcitationCost, budget: Budget, seed: int, progress: Progress | None = None) -> FoundMotion:
    """Search for the motion of least cost; the last stage has firm penalties, so that limits are nearly obeyed.

    The global stage are local searches from the best random motions. In 63 dimensions and 500 evaluations NLopt's
    GN_CRS2_LM found nothing better than the best of 60 random motions.

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
    return FoundMotion(settled.x, watched.count + settled.evaluations, spent)


def enforce_limits(cost: ExcitationCost, x: Array, budget: Budget, progress: Progress | None = None) -> FoundMotion:
    """Last stage of a search, from x (n, d) [rad or m]: minimise the cost with firm penalties."""
    firm = replace(cost, penalty=FIRM * cost.penalty)
    watched = _Watched(firm, budget, progress, budget.total - budget.firm)
    best = watched.improve(np.clip(cost.relative(x), -BOX, BOX), budget.firm, "settling")
    fine = cost.family.basis(np.arange(0, cost.t[-1], GRID))
    x = fit_inside(fine, cost.problem.limits, cost.parameters(best.x))
    return FoundMotion(x, watched.count, best.status == "budget")


class _Watched:
    """Cost that counts evaluations, reports progress and caches the last value."""

    def __init__(self, cost: ExcitationCost, budget: Budget, progress: Progress | None, before: int = 0) -> None:
        self.cost, self.budget, self.progress = cost, budget, progress
        self.count, self.before, self.stage = 0, before, "drawing"
        self.last: tuple[bytes, float] = b"", np.inf

    def improve(self, z: Array, evaluations: int, stage: str) -> Optimum:
        """Best point of a local search from z (d,) [1]."""
        box, self.stage, self.last = np.full(len(z), BOX), stage, (b"", np.inf)
        problem = Problem(self.value, -box, box, steady(z), self.slope, SEARCH)
        return OPTIMISERS["nlopt"].minimise(problem, algorithm=ALGORITHM, budget_evaluations=evaluations)

    def value(self, z: Array) -> float:
        """Cost of z (d,) [1]."""
        self.count += 1
        if self.progress is not None:
            self.progress(f"{self.stage} motions", min(1.0, (self.before + self.count) / self.budget.total))
        return self.last[1] if self.last[0] == z.tobytes() else float(steady(np.array(self.cost.value(z))))

    def slope(self, z: Array) -> Array:
        """Gradient (d,) [1] of the cost at z (d,) [1]."""
        value, slope = self.cost.value_and_slope(z)
        self.last = z.tobytes(), float(steady(np.array(value)))
        return steady(slope)


class FeasibleMotion(NamedTuple):
    """Motion within the limits."""

    x: Array  # (n, d) [rad or m] parameters
    share: float  # [1] scale of the motion about the home posture
    distance: float | None  # [m] smallest distance between links


def make_feasible(problem: ExcitationProblem, family: Family, x: Array) -> FeasibleMotion:
    """Scale a motion of parameters x (n, d) [rad or m] by as little as needed to obey all limits.

    Each joint is scaled to its position, velocity and acceleration limits. If torque or the distance between links
    exceeds a limit, the whole motion shrinks towards the home posture.

    Raises:
        OptionError: even a small motion exceeds a torque limit.
    """
    t = grid(family.duration, FINE)
    full = fit_inside(family.basis(t), problem.limits, x)
    home = np.zeros_like(full)
    home[:, 0] = problem.home
    best, high, share = FeasibleMotion(home, 0.0, None), 1.0, 1.0
    for _ in range(HALVINGS):
        tried = home + share * (full - home)
        ok, distance = _obeys(problem, family, t, tried)
        if ok:
            best = FeasibleMotion(tried, share, distance)
        else:
            high = share
        if best.share == high:
            break
        share = (best.share + high) / 2
    if best.share == 0.0:
        raise OptionError("even a small motion exceeds a torque limit; raise the limit, or state lower friction")
    return best


def grid(duration: float, step: float = FINE) -> Array:
    """Instants (N,) [s] from 0 to the duration [s], at most a step [s] apart."""
    return np.linspace(0, duration, int(np.ceil(duration / step)) + 1)


def _obeys(problem: ExcitationProblem, family: Family, t: Array, x: Array) -> tuple[bool, float | None]:
    """Whether a motion obeys all limits, and the smallest distance between links [m], None without their shapes."""
    shapes, clearance = problem.collision, problem.clearance
    if shapes is not None:  # a coarse grid shows most collisions
        if shapes.distance(family.basis(t[::COARSE])[0] @ x.T).min() < clearance:
            return False, None
    use = problem.use(family.sample(problem.model.robot.joints, x, t))
    if use.largest > problem.limits.margin + SLACK:
        return False, None
    if shapes is None:
        return True, None
    distance = float(shapes.distance(family.basis(grid(float(t[-1]), NEAR))[0] @ x.T).min())
    return distance >= clearance, distance
