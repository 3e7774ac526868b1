"""What an optimiser is given and what it gives back."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, Literal

import numpy as np

from ..deadline import time_is_up
from ..errors import OptionError
from ..types import Array, Frozen

Status = Literal["converged", "budget", "failed"]
WALL = 1e100  # cost that stands for infinity


@dataclass(frozen=True, eq=False)
class Problem(Frozen):
    """Minimise objective(x) over lower <= x <= upper, from start.

    Raises:
        ValueError: when the three vectors have different lengths, a box is empty or the start lies outside.
    """

    objective: Callable[[Array], float]  # x (d,) -> cost
    lower: Array  # (d,) [any], -inf where free
    upper: Array  # (d,) [any], inf where free
    start: Array  # (d,) [any]
    gradient: Callable[[Array], Array] | None = None  # x (d,) -> (d,)
    search: str = "a search"  # what is searched; time may cut it short
    tolerance: float = 0.0  # of the cost: steps that change it less end the search, where the library can

    def __post_init__(self) -> None:
        """Arrays are copied and checked."""
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
                "start inside the box"
            )


@dataclass(frozen=True, eq=False)
class Optimum(Frozen):
    """The best point seen; a spent budget is a result, not an error."""

    x: Array  # (d,) [any]
    value: float
    status: Status
    evaluations: int
    algorithm: str


class Optimiser(ABC):
    """A library of algorithms behind one verb."""

    algorithms: tuple[str, ...]  # the first is the default
    needs_gradient: frozenset[str]  # those among them that cannot do without

    @abstractmethod
    def minimise(
        self,
        problem: Problem,
        *,
        algorithm: str | None = None,
        budget_evaluations: int,
        budget_seconds: float | None = None,
        seed: int = 0,
    ) -> Optimum:
        """The best point that the budget allowed; the same for the same seed, unless the seconds ran out first.

        Args:
            problem: what to minimise.
            algorithm: one of `algorithms`.
            budget_evaluations: of the objective, at most; the start is always evaluated.
            budget_seconds: the same in time [s].
            seed: of random numbers.

        Raises:
            OptionError: when there is no such algorithm, or it needs a gradient that the problem lacks.
        """

    def chosen(self, problem: Problem, algorithm: str | None) -> str:
        """The name of an algorithm that can solve the problem.

        Raises:
            OptionError: when there is no such algorithm, or it needs a gradient that the problem lacks.
        """
        name = algorithm or self.algorithms[0]
        if name not in self.algorithms:
            upper = {known.upper(): known for known in self.algorithms}
            close = [upper[key] for key in get_close_matches(name.upper(), upper, n=3, cutoff=0.4)]
            raise OptionError(f"there is no algorithm {name!r}; choose from {', '.join(close or self.algorithms)}")
        if name in self.needs_gradient and problem.gradient is None:
            raise OptionError(
                f"the algorithm {name!r} needs a gradient and the problem has none; give one, or choose an algorithm "
                "that does without"
            )
        return name


class BudgetSpentError(Exception):
    """Thrown through a library to end it."""


class Watch:
    """Calls the objective, first at the start; counts, keeps the best point, ends the run when the budget is spent."""

    def __init__(self, problem: Problem, evaluations: int, seconds: float | None) -> None:
        self.problem, self.evaluations = problem, evaluations
        self.end = np.inf
        self.x, self.value, self.count = problem.start, np.inf, 0
        self.fault: Exception | None = None  # of the objective itself, not of the library
        self(problem.start)  # not every algorithm looks there, and the answer is to be no worse
        if seconds is not None:
            self.end = time.monotonic() + seconds

    def __call__(self, x: Array) -> float:
        """Cost at x: (d,) [any], a wall where it is no finite number: some algorithms crash there, or never end."""
        spent = self.count >= max(self.evaluations, 1) or time.monotonic() >= self.end
        if spent or (self.count and time_is_up(self.problem.search)):
            raise BudgetSpentError
        self.count += 1
        value = float(self._watched(self.problem.objective, x))
        if value < self.value and np.all((x >= self.problem.lower) & (x <= self.problem.upper)):  # some look outside
            self.x, self.value = np.array(x), value
        return value if np.isfinite(value) else WALL

    def gradient(self, x: Array) -> Array:
        """(d,) gradient at x: (d,) [any], level where it is no finite number."""
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
        """The best point so far.

        Raises:
            Exception: that of the objective or its gradient, which is not the library's to hide.
        """
        if self.fault is not None:
            raise self.fault
        if not np.isfinite(self.value):
            status = "failed"
        elif status == "converged" and self.count >= self.evaluations:
            status = "budget"
        return Optimum(self.x, self.value, status, self.count, algorithm)
