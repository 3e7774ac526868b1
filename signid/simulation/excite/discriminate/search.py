"""Search for the motion along which two laws differ most."""

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
from .law_distance import Distance, LawPair

POOL, POLISHED, EVALUATIONS = 60, 4, 120  # random motions; best ones that are improved; evaluations for each of these
AMPLITUDE = (0.1, 1.0)  # [1] smallest and largest share of the limits that a random motion uses
REACH = 0.5  # [1] largest change of a parameter, as a share of the value at which it alone meets a limit
ALGORITHM = "LN_SBPLX"
PLACES = 50  # samples at which distances between links are computed
PENALTY = 1e3  # [1] on the mean square excess over a limit; the objective is the log of a distance
LEAST = 1e-30  # [1] smallest distance, since the log of zero is infinite


class MotionCandidate(NamedTuple):
    """Motion and the distance of the laws along it."""

    family: Family
    x: Array  # (n, d) [rad or m]
    distance: Distance
    evaluations: int = 1  # motions evaluated to find it
    spent: bool = False  # whether the budget ended its search before an optimum


@dataclass(frozen=True, eq=False)
class MotionSearch(Frozen):
    """Search over motions of some families for a large distance of two laws.

    `ways` are the directions of the distance that count: 0 for the first law true, 1 for the second.
    """

    laws: LawPair
    t: Array  # (N,) [s] samples at which distances are computed
    families: Sequence[Family]
    seed: int
    progress: Progress | None

    def random_pool(self) -> list[MotionCandidate]:
        """Random motions of random centre and size, scaled to the limits of position, velocity and acceleration."""
        rng, limits, found = np.random.default_rng(self.seed), self.laws.problem.limits, []
        for k in range(POOL):
            family = self.families[k % len(self.families)]
            x = random_parameters(self._bases[id(family)], limits, rng, AMPLITUDE)
            found.append(MotionCandidate(family, x, self.distance(family, x)))
            self._report("drawing motions", k, POOL)
        return found

    def improve(self, pool: Sequence[MotionCandidate], ways: Sequence[int]) -> list[MotionCandidate]:
        """The best motions of a pool, improved one after another."""
        ranked = sorted(pool, key=lambda one: self.objective(one.family, one.x, ways), reverse=True)[:POLISHED]
        return [self._improved(one, ways, k) for k, one in enumerate(ranked)]

    def distance(self, family: Family, x: Array) -> Distance:
        """Distance of the laws along the motion of parameters x (n, d) [rad or m]."""
        return self.laws.distance(sample(family, self.laws.problem.model.robot.joints, x, self.t))

    def objective(self, family: Family, x: Array, ways: Sequence[int]) -> float:
        """Log of the smaller distance, less penalties on torque and contact; x: (n, d) [rad or m]."""
        problem = self.laws.problem
        motion = sample(family, problem.model.robot.joints, x, self.t)
        torque = problem.model.inverse(Motion(problem.model.robot, motion.t, motion.q, motion.v, motion.a))
        over = np.maximum(np.abs(torque) / (problem.limits.margin * problem.limits.torque) - 1, 0)
        excess = float(np.sum(over**2)) / len(self.t)
        if problem.collision is not None:
            few = motion.q[:: max(1, len(motion.q) // PLACES)]
            excess += problem.collision.penalty(few, problem.clearance, SPARE)[0]
        return float(np.log(max(self.smaller(self.laws.distance(motion), ways), LEAST))) - PENALTY * excess

    def smaller(self, distance: Distance, ways: Sequence[int]) -> float:
        """Smaller one of the distances that count."""
        return min((distance.seen[way] for way in ways), default=0.0)

    def _improved(self, start: MotionCandidate, ways: Sequence[int], turn: int) -> MotionCandidate:
        family, limits = start.family, self.laws.problem.limits
        basis, count = self._bases[id(family)], 0
        sizes = column_sizes(basis, limits)
        sizes[:, 0] = limits.half

        def inside(change: Array) -> Array:
            return fit_inside(basis, limits, start.x + change.reshape(sizes.shape) * sizes)

        def cost(change: Array) -> float:
            nonlocal count
            count += 1
            self._report("improving motions", turn * EVALUATIONS + count, POLISHED * EVALUATIONS)
            return -self.objective(family, inside(change), ways)

        reach = np.full(sizes.size, REACH)
        problem = Problem(cost, -reach, reach, np.zeros(sizes.size), search=SEARCH)
        best = OPTIMISERS["nlopt"].minimise(problem, algorithm=ALGORITHM, budget_evaluations=EVALUATIONS)
        x = inside(best.x)
        return MotionCandidate(family, x, self.distance(family, x), best.evaluations, best.status == "budget")

    @cached_property
    def _bases(self) -> dict[int, Array]:
        fine = np.linspace(0, self.t[-1], 1 + 20 * int(self.t[-1] + 1))
        return {id(family): family.basis(fine) for family in self.families}

    def _report(self, what: str, done: int, total: int) -> None:
        if self.progress is not None:
            self.progress(what, min(1.0, done / total))
