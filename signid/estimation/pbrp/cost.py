"""Cost of the search for standard parameters, in coordinates scaled by the box, and its rounds of penalty."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ...optimisers import OPTIMISERS, Optimum, Problem
from ...types import Array, Frozen, Indices
from .bounds import Bounds
from .penalty import Physics

SEARCH = "the search for standard parameters"
_LARGE = 1e3  # [squared standard deviations] cost above which a search that stopped early is repeated


@dataclass(frozen=True, eq=False)
class PenaltyCost(Frozen):
    """Cost |matrix z - target|^2 + rest + weight * violation of physics, z (d,) in the unit cube.

    Free standard parameters are x = lower + (upper - lower) z; those with equal bounds are fixed.
    """

    matrix: Array  # (m, d) [standard deviations]
    target: Array  # (m,) [standard deviations]
    rest: float  # [squared standard deviations] part that no parameters explain
    free: Indices  # (d,) standard parameters of z
    box: Bounds
    physics: Physics

    @property
    def width(self) -> Array:
        """Width (d,) of the box [unit of each]."""
        return self.box.upper[self.free] - self.box.lower[self.free]

    def standard(self, z: Array) -> Array:
        """Standard parameters (p,) [unit of each].

        Args:
            z: (d,) [1].
        """
        x = self.box.lower.copy()
        x[self.free] += self.width * z
        return x

    def problem(self, z: Array, weight: float) -> Problem:
        """Optimisation problem that starts at z.

        Args:
            z: (d,) starting point [1].
            weight: weight of the violation [squared standard deviations].
        """
        width, matrix, target = self.width, self.matrix, self.target

        def cost(z: Array) -> float:
            off = matrix @ z - target
            penalty = weight * self.physics.excess(self.standard(z)) if weight else 0.0
            return float(off @ off) + self.rest + penalty

        def gradient(z: Array) -> Array:
            slope = 2 * matrix.T @ (matrix @ z - target)
            if weight:
                slope += weight * width * self.physics.violation(self.standard(z))[1][self.free]
            return np.asarray(slope)

        return Problem(cost, np.zeros(len(z)), np.ones(len(z)), z, gradient, SEARCH)


def cost_over(box: Bounds, physics: Physics, matrix: Array, target: Array, rest: float = 0.0) -> PenaltyCost:
    """Cost |matrix x - target|^2 + rest over the standard parameters x of a box.

    Args:
        box: search box.
        physics: constraints of physics.
        matrix: (m, p) [standard deviations per unit of each].
        target: (m,) [standard deviations].
        rest: part that no parameters explain [squared standard deviations].
    """
    free = np.flatnonzero(box.upper > box.lower)
    inside = matrix[:, free] * (box.upper - box.lower)[free]
    return PenaltyCost(inside, target - matrix @ box.lower, rest, free, box, physics)


def descend(cost: PenaltyCost, z: Array, weights: Iterable[float], algorithm: str, budget: int, seed: int) -> Optimum:
    """Rounds of one algorithm; each has its own weight of the penalty and starts where the last one ended.

    Args:
        cost: cost to minimise.
        z: (d,) starting point [1].
        weights: weights of the penalty, one per round [squared standard deviations].
        algorithm: name of an NLopt algorithm.
        budget: evaluations per round.
        seed: seed of the random generator.

    Raises:
        OptionError: there is no such algorithm.
    """
    found = Optimum(z, np.inf, "failed", 0, algorithm)
    for weight in weights:
        last = found.evaluations
        found = _minimise(cost.problem(found.x, weight), algorithm, budget, seed)
        found = replace(found, evaluations=last + found.evaluations)
    return found


def _minimise(problem: Problem, algorithm: str, budget: int, seed: int) -> Optimum:
    """Minimise, and once more in units of the cost reached if it is large: some algorithms stop early then."""
    search = OPTIMISERS["nlopt"].minimise
    found = search(problem, algorithm=algorithm, budget_evaluations=budget, seed=seed)
    left, size, slope = budget - found.evaluations, found.value, problem.gradient
    if left < 1 or slope is None or not _LARGE < size < np.inf:
        return found
    eased = replace(
        problem, objective=lambda z: problem.objective(z) / size, start=found.x, gradient=lambda z: slope(z) / size
    )
    again = search(eased, algorithm=algorithm, budget_evaluations=left, seed=seed)
    return replace(again, value=again.value * size, evaluations=found.evaluations + again.evaluations)
