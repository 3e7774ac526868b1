"""What a search for standard parameters minimises, in coordinates scaled by the box, and its rounds of penalty."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ...optimisers import OPTIMISERS, Optimum, Problem
from ...types import Array, Frozen, Indices
from .bounds import Bounds
from .penalty import Physics

SEARCH = "the search for standard parameters"
_LARGE = 1e3  # squared standard deviations: misfit and penalty together, of a search that has not come far


@dataclass(frozen=True, eq=False)
class Cost(Frozen):
    """|matrix z - target|^2 + rest + weight * violation of physics, z (d,) in the unit cube.

    The cube stands for the free part of a box: x = lower + (upper - lower) z where a bound leaves room.
    """

    matrix: Array  # (m, d) [standard deviations]
    target: Array  # (m,) [standard deviations]
    rest: float  # squared standard deviations that no parameters explain
    free: Indices  # (d,) the standard parameters that z stands for
    box: Bounds
    physics: Physics

    @property
    def width(self) -> Array:
        """(d,) of the box [unit of each]."""
        return self.box.upper[self.free] - self.box.lower[self.free]

    def standard(self, z: Array) -> Array:
        """(p,) standard parameters [unit of each].

        Args:
            z: (d,) [1].
        """
        x = self.box.lower.copy()
        x[self.free] += self.width * z
        return x

    def problem(self, z: Array, weight: float) -> Problem:
        """From z on, with a penalty of that weight.

        Args:
            z: (d,) [1].
            weight: of the violation [squared standard deviations].
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


def cost_over(box: Bounds, physics: Physics, matrix: Array, target: Array, rest: float = 0.0) -> Cost:
    """The cost |matrix x - target|^2 + rest over the standard parameters x of a box.

    Args:
        box: where to search.
        physics: what a real robot obeys.
        matrix: (m, p) [standard deviations per unit of each].
        target: (m,) [standard deviations].
        rest: squared standard deviations that no parameters explain.
    """
    free = np.flatnonzero(box.upper > box.lower)
    inside = matrix[:, free] * (box.upper - box.lower)[free]
    return Cost(inside, target - matrix @ box.lower, rest, free, box, physics)


def descend(cost: Cost, z: Array, weights: Iterable[float], algorithm: str, budget: int, seed: int) -> Optimum:
    """Rounds of one algorithm, each with a penalty of its own and from where the last one ended.

    Args:
        cost: what to minimise.
        z: (d,) [1] where to begin.
        weights: of the penalty [squared standard deviations].
        algorithm: of NLopt.
        budget: evaluations per round.
        seed: of random numbers.

    Raises:
        OptionError: when there is no such algorithm.
    """
    found = Optimum(z, np.inf, "failed", 0, algorithm)
    for weight in weights:
        last = found.evaluations
        found = _minimise(cost.problem(found.x, weight), algorithm, budget, seed)
        found = replace(found, evaluations=last + found.evaluations)
    return found


def _minimise(problem: Problem, algorithm: str, budget: int, seed: int) -> Optimum:
    """Some algorithms stop early where costs are large: from there once more, in units of the cost that is left."""
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
