"""NLopt: global and local minimisation, with and without gradients."""

from __future__ import annotations

from weakref import ref

import nlopt
import numpy as np

from ..types import Array
from . import Optimiser, Optimum, Problem, Status, Watch

_ALGORITHM_PREFIXES = ("GN_", "GD_", "LN_", "LD_", "G_", "AUGLAG")
_LIMIT_CODES = (nlopt.MAXEVAL_REACHED, nlopt.MAXTIME_REACHED, nlopt.FORCED_STOP)


class NLopt(Optimiser):
    """All algorithms of the installed NLopt under their own names: GN_CRS2_LM, LD_SLSQP, LN_SBPLX, ...

    Source: S. G. Johnson, The NLopt nonlinear-optimization package.
    """

    algorithms = (
        "LN_SBPLX",
        *(name for name in sorted(dir(nlopt)) if name.startswith(_ALGORITHM_PREFIXES) and name != "LN_SBPLX"),
    )
    needs_gradient = frozenset(name for name in algorithms if name.startswith(("GD_", "LD_")))

    def minimise(
        self, problem: Problem, *, algorithm: str | None = None, budget_evaluations: int, seed: int = 0
    ) -> Optimum:
        name = self.chosen(problem, algorithm)
        watch, run = Watch(problem, budget_evaluations), _configured(name, problem)
        kept = ref(run)  # weak: NLopt holds the cost function, and a strong reference back would leak both

        def cost(x: Array, gradient: Array) -> float:
            try:
                if gradient.size:
                    gradient[:] = watch.gradient(x)
                return watch(x)
            except Exception:  # must not pass through NLopt, which would keep calling
                if (running := kept()) is not None:
                    running.force_stop()
                gradient[:] = 0.0
                return watch.value

        nlopt.srand(seed % 2**32)
        run.set_min_objective(cost)
        run.set_maxeval(budget_evaluations)
        status: Status = "converged"
        try:
            run.optimize(problem.start)
            status = "budget" if run.last_optimize_result() in _LIMIT_CODES else "converged"
        except nlopt.RoundoffLimited:  # converged to rounding
            pass
        except nlopt.ForcedStop:
            status = "budget"
        except Exception:  # NLopt's exceptions share no base class
            status = "failed"
        return watch.optimum(status, name)


def _configured(name: str, problem: Problem) -> nlopt.opt:
    run = nlopt.opt(getattr(nlopt, name), len(problem.start))
    run.set_lower_bounds(problem.lower)
    run.set_upper_bounds(problem.upper)
    run.set_xtol_rel(1e-10)
    run.set_ftol_rel(1e-13)
    run.set_ftol_abs(problem.tolerance)
    if "AUGLAG" in name or "MLSL" in name:
        gradient = name.startswith(("LD_", "GD_"))
        local = nlopt.opt(nlopt.LD_LBFGS if gradient else nlopt.LN_SBPLX, len(problem.start))
        local.set_xtol_rel(1e-10)
        local.set_ftol_rel(1e-13)
        run.set_local_optimizer(local)
    width = problem.upper - problem.lower
    if np.isfinite(width).all() and (width > 0).all():
        run.set_initial_step(width / 10)
    return run


PLUGIN = NLopt()
