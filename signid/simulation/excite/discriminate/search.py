"""The search for the motion along which two laws differ most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ....optimisers import OPTIMISERS, Problem
from ....regression.motion import Motion
from ....types import Array, Frozen, Progress
from ..motions.family import Family
from ..motions.random_motion import column_sizes, fit_inside, random_parameters, sample
from ..search import SEARCH, SPARE
from .law_distance import Distance, Rivals

POOL, POLISHED, EVALUATIONS = 60, 4, 120  # random motions; the best of them; steps for each
AMPLITUDE = (0.1, 1.0)  # least and most share of the limits that a random motion uses
REACH = 0.5  # by which a parameter may be changed, of what alone meets a limit
ALGORITHM = "LN_SBPLX"
PLACES = 50  # instants at which links are looked at
PENALTY = 1e3  # on what exceeds a limit: log of a distance per mean square share
LEAST = 1e-30  # distance whose log is taken instead of zero's


class Tried(NamedTuple):
    """A motion and how far it sets the laws apart."""

    family: Family
    x: Array  # (n, d) [rad or m]
    distance: Distance
    evaluations: int = 1  # motions judged to find it
    spent: bool = False  # whether a budget ended its search, before it arrived at an optimum


@dataclass(frozen=True, eq=False)
class Duel(Frozen):
    """Motions of some families, judged by the distance of two laws."""

    rivals: Rivals
    t: Array  # (N,) [s] at which motions are judged
    families: Sequence[Family]
    seed: int
    progress: Progress | None

    def draw(self) -> list[Tried]:
        """Random motions of random centre and size, scaled to the limits of position, velocity and acceleration."""
        rng, limits, found = np.random.default_rng(self.seed), self.rivals.problem.limits, []
        for k in range(POOL):
            family = self.families[k % len(self.families)]
            x = random_parameters(self._bases[id(family)], limits, rng, AMPLITUDE)
            found.append(Tried(family, x, self.distance(family, x)))
            self._tell("drawing motions", k, POOL)
        return found

    def polish(self, pool: Sequence[Tried], ways: Sequence[int]) -> list[Tried]:
        """The best few, improved one after another."""
        ranked = sorted(pool, key=lambda tried: self.worth(tried.family, tried.x, ways), reverse=True)[:POLISHED]
        return [self._polished(tried, ways, k) for k, tried in enumerate(ranked)]

    def distance(self, family: Family, x: Array) -> Distance:
        """Of the laws along the motion of parameters x (n, d) [rad or m]."""
        return self.rivals.distance(sample(family, self.rivals.problem.model.robot.joints, x, self.t))

    def worth(self, family: Family, x: Array, ways: Sequence[int]) -> float:
        """Log of the smaller distance, less penalties on torque and contact; x: (n, d) [rad or m]."""
        problem = self.rivals.problem
        motion = sample(family, problem.model.robot.joints, x, self.t)
        torque = problem.model.inverse(Motion(problem.model.robot, motion.t, motion.q, motion.v, motion.a))
        over = np.maximum(np.abs(torque) / (problem.limits.margin * problem.limits.torque) - 1, 0)
        lost = float(np.sum(over**2)) / len(self.t)
        if problem.collision is not None:
            few = motion.q[:: max(1, len(motion.q) // PLACES)]
            lost += problem.collision.penalty(few, problem.clearance, SPARE)[0]
        return float(np.log(max(self.smaller(self.rivals.distance(motion), ways), LEAST))) - PENALTY * lost

    def smaller(self, distance: Distance, ways: Sequence[int]) -> float:
        """Of the ways in which any motion tells the laws apart."""
        return min((distance.seen[way] for way in ways), default=0.0)

    def _polished(self, tried: Tried, ways: Sequence[int], turn: int) -> Tried:
        family, limits = tried.family, self.rivals.problem.limits
        basis, count = self._bases[id(family)], 0
        sizes = column_sizes(basis, limits)
        sizes[:, 0] = limits.half

        def inside(change: Array) -> Array:
            return fit_inside(basis, limits, tried.x + change.reshape(sizes.shape) * sizes)

        def cost(change: Array) -> float:
            nonlocal count
            count += 1
            self._tell("improving motions", turn * EVALUATIONS + count, POLISHED * EVALUATIONS)
            return -self.worth(family, inside(change), ways)

        reach = np.full(sizes.size, REACH)
        problem = Problem(cost, -reach, reach, np.zeros(sizes.size), search=SEARCH)
        best = OPTIMISERS["nlopt"].minimise(problem, algorithm=ALGORITHM, budget_evaluations=EVALUATIONS)
        x = inside(best.x)
        return Tried(family, x, self.distance(family, x), best.evaluations, best.status == "budget")

    @cached_property
    def _bases(self) -> dict[int, Array]:
        fine = np.linspace(0, self.t[-1], 1 + 20 * int(self.t[-1] + 1))
        return {id(family): family.basis(fine) for family in self.families}

    def _tell(self, what: str, done: int, total: int) -> None:
        if self.progress is not None:
            self.progress(what, min(1.0, done / total))
