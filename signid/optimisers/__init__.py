"""Minimisers, one library per file.

A `Problem` is an objective with bounds, a start and an optional gradient. `OPTIMISERS["nlopt"].minimise` solves it and
returns an `Optimum`. To add a library, write a module here and add its name below, or register an entry point
`signid.optimisers` in another package.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, Literal

import numpy as np

from ..deadline import time_is_up
from ..errors import OptionError
from ..registry import Registry
from ..types import Array, Frozen

Status = Literal["converged", "budget", "failed"]
WALL_COST = 1e100  # finite cost that replaces infinite and undefined costs


@dataclass(frozen=True, eq=False)
class Problem(Frozen):
    """Minimise objective(x) subject to lower <= x <= upper, from `start`."""

    objective: Callable[[Array], float]  # x (d,) -> cost
    lower: Array  # (d,) [any], -inf where unbounded
    upper: Array  # (d,) [any], inf where unbounded
    start: Array  # (d,) [any]
    gradient: Callable[[Array], Array] | None = None  # x (d,) -> (d,)
    search: str = "a search"  # name of the search in the flag of the time limit
    tolerance: float = 0.0  # absolute change of the cost at which the search converges, if the library supports it

    def __post_init__(self) -> None:
        """Copy and check the arrays."""
        super().__post_init__()
        if not self.lower.shape == self.upper.shape == self.start.shape == (len(self.start),):
            raise ValueError(
                f"lower, upper and start have shapes {self.lower.shape}, {self.upper.shape} and {self.start.shape}; "
                "give three vectors of one length"
            )
        outside = ~((self.lower <= self.start) & (self.start <= self.upper))
        if outside.any():
            i = int(np.flatnonzero(outside)[0])
            raise ValueError(
                f"start[{i}] = {self.start[i]:g} is not between {self.lower[i]:g} and {self.upper[i]:g}; "
                "start within the bounds"
            )


@dataclass(frozen=True, eq=False)
class Optimum(Frozen):
    """Best point found; a spent budget is a status, not an error."""

    x: Array  # (d,) [any]
    value: float
    status: Status
    evaluations: int
    algorithm: str


class Optimiser(ABC):
    """A library of minimisation algorithms."""

    algorithms: tuple[str, ...]  # the first is the default
    needs_gradient: frozenset[str]  # algorithms that require a gradient

    @abstractmethod
    def minimise(
        self, problem: Problem, *, algorithm: str | None = None, budget_evaluations: int, seed: int = 0
    ) -> Optimum:
        """Minimise within a number of evaluations; reproducible for a given seed unless the time limit passes first.

        The algorithm is one of `algorithms`; None: the first. The start is always evaluated.

        Raises:
            OptionError: unknown algorithm, or an algorithm that requires a gradient for a problem without one.
        """

    def chosen(self, problem: Problem, algorithm: str | None) -> str:
        """Name of the algorithm, checked against the problem.

        Raises:
            OptionError: unknown algorithm, or an algorithm that requires a gradient for a problem without one.
        """
        name = algorithm or self.algorithms[0]
        if name not in self.algorithms:
            upper = {known.upper(): known for known in self.algorithms}
            close = [upper[key] for key in get_close_matches(name.upper(), upper, n=3, cutoff=0.4)]
            raise OptionError(f"there is no algorithm {name!r}; choose from {', '.join(close or self.algorithms)}")
        if name in self.needs_gradient and problem.gradient is None:
            raise OptionError(
                f"the algorithm {name!r} needs a gradient and the problem has none; give one, or choose an algorithm "
                "without gradients"
            )
        return name


class BudgetSpentError(Exception):
    """Raised inside an objective to end the run of a library."""


class Watch:
    """Objective that counts evaluations, keeps the best point and ends the run when the budget is spent."""

    def __init__(self, problem: Problem, evaluations: int) -> None:
        self.problem, self.evaluations = problem, evaluations
        self.x, self.value, self.count = problem.start, np.inf, 0
        self.fault: Exception | None = None  # raised by the objective, not by the library
        self(problem.start)  # some algorithms skip the start; the optimum must not be worse than it

    def __call__(self, x: Array) -> float:
        """Cost at x: (d,) [any], `WALL_COST` where it is not finite: some algorithms crash there, or never end."""
        if self.count >= max(self.evaluations, 1) or (self.count and time_is_up(self.problem.search)):
            raise BudgetSpentError
        self.count += 1
        value = float(self._watched(self.problem.objective, x))
        inside = (x >= self.problem.lower) & (x <= self.problem.upper)  # some algorithms leave the bounds
        if value < self.value and np.all(inside):
            self.x, self.value = np.array(x), value
        return value if np.isfinite(value) else WALL_COST

    def gradient(self, x: Array) -> Array:
        """Gradient (d,) at x: (d,) [any], zero where it is not finite."""
        assert self.problem.gradient is not None, "checked when the algorithm was chosen"
        slope = np.asarray(self._watched(self.problem.gradient, x))
        return np.where(np.isfinite(slope), slope, 0.0)

    def _watched(self, function: Callable[[Array], Any], x: Array) -> Any:
        try:
            return function(x)
        except Exception as fault:
            self.fault = fault
            raise

    def optimum(self, status: Status, algorithm: str) -> Optimum:
        """Best point so far; raises exceptions of the objective or its gradient, even if the library caught them."""
        if self.fault is not None:
            raise self.fault
        if not np.isfinite(self.value):
            status = "failed"
        elif status == "converged" and self.count >= self.evaluations:
            status = "budget"
        return Optimum(self.x, self.value, status, self.count, algorithm)


OPTIMISERS: Registry[Optimiser] = Registry("optimisers", __name__, "nlopt_")
