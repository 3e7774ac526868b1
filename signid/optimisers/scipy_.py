"""SciPy: three of its minimisers."""

from __future__ import annotations

import numpy as np
from scipy import optimize

from .base import BudgetSpentError, Optimiser, Optimum, Problem, Status, Watch


class SciPy(Optimiser):
    """L-BFGS-B and trust-constr, with differences where the problem has no gradient, and differential evolution.

    Source: Virtanen et al., Nature Methods 17, 2020.
    """

    algorithms = ("L-BFGS-B", "trust-constr", "differential_evolution")
    needs_gradient = frozenset()

    def minimise(
        self,
        problem: Problem,
        *,
        algorithm: str | None = None,
        budget_evaluations: int,
        budget_seconds: float | None = None,
        seed: int = 0,
    ) -> Optimum:
        name = self.chosen(problem, algorithm)
        watch = Watch(problem, budget_evaluations, budget_seconds)
        box = optimize.Bounds(problem.lower, problem.upper)
        status: Status = "budget"
        most = max(budget_evaluations, 1)  # rounds, too: trust-constr can go on without evaluations
        try:
            if name == "differential_evolution":
                rng = np.random.default_rng(seed)
                found = optimize.differential_evolution(watch, box, x0=problem.start, rng=rng, maxiter=most)
            else:
                slope = watch.gradient if problem.gradient else None
                limits = {"maxiter": most} | ({"maxfun": most} if name == "L-BFGS-B" else {})
                found = optimize.minimize(watch, problem.start, method=name, jac=slope, bounds=box, options=limits)
            status = "converged" if found.success else "budget" if found.nit >= most else "failed"
        except BudgetSpentError:
            pass
        except Exception:  # the watch raises those of the objective again
            status = "failed"
        return watch.optimum(status, name)


PLUGIN = SciPy()
