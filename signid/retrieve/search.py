"""The penalty-based search itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..consistent.cone import information_root
from ..errors import OptionError
from ..optimisers import OPTIMISERS, Problem
from ..types import Array, BaseMap, Estimate, Frozen, Label, Parameters
from .bounds import Bounds, bounds_around
from .penalty import Physics, physics_of

_SHARPEST = 1e4  # standard deviations per width of the box that the search is asked to resolve
_SETTLED = 1e-2  # gain still in sight over the whole box, in squared standard deviations, at which a run has converged
_MORE = 6  # rounds of a tenfold penalty, as long as the result is still impossible


@dataclass(frozen=True)
class Run:
    """One start of the search and where it ended, judged by the pseudo-inertia test and the gradient."""

    cost: float  # chi2, with what is known very sharply eased, plus the last penalty
    chi2: float  # squared distance from the estimate, in its own information
    violation: float  # of physics, 0 where there is none
    feasible: bool
    converged: bool
    evaluations: int


@dataclass(frozen=True, eq=False)
class Retrieval(Frozen):
    """The best of the runs."""

    parameters: Parameters
    best: Run
    runs: tuple[Run, ...]
    global_algorithm: str
    local_algorithm: str
    seed: int
    notes: tuple[str, ...] = ()

    @property
    def cost(self) -> float:
        """Distance from the estimate, with what is known very sharply eased, plus the last penalty."""
        return self.best.cost

    @property
    def chi2(self) -> float:
        """Squared distance from the estimate, in its own information."""
        return self.best.chi2

    @property
    def violation(self) -> float:
        """Of physics, 0 where there is none."""
        return self.best.violation

    @property
    def feasible(self) -> bool:
        """Whether a real robot could have the parameters; proved by Cholesky factors."""
        return self.best.feasible

    @property
    def converged(self) -> bool:
        """Whether no direction in the box promises a better cost."""
        return self.best.converged


def retrieve(
    base: BaseMap,
    estimate: Estimate,
    prior: Parameters,
    bounds: Bounds | None = None,
    *,
    global_algorithm: str = "GN_CRS2_LM",
    local_algorithm: str = "LD_LBFGS",
    runs: int = 3,
    rounds: int = 10,
    schedule: float = 10.0,
    seed: int = 0,
    total_mass: tuple[float, float] | None = None,
    budget_global: int = 10_000,
    budget_local: int = 2_000,
) -> Retrieval:
    """Standard parameters in a box that reproduce the base parameters and obey physics, as far as a search finds them.

    Each run starts anywhere in the box. Its first round asks only for the base parameters, by a global and then a local
    algorithm; each later round starts from the last and adds a heavier penalty, `schedule` times its number, on what
    violates physics. Should the last still be impossible, up to six rounds of a tenfold penalty follow. Good up to some
    30 parameters; above that it stays within its budget and says how it ended.

    Args:
        base: which combinations of the standard parameters the torque shows.
        estimate: base parameters and their information.
        prior: standard parameters of the description; they give the box and the sizes, not the answer.
        bounds: the box; around the prior by default.
        global_algorithm: of NLopt, for the first round.
        local_algorithm: of NLopt, for every round.
        runs: starts, of which the best is kept.
        rounds: of growing penalty.
        schedule: penalty per round, in squared standard deviations.
        seed: of the starts and of the global algorithm.
        total_mass: least and largest sum of the masses of all moving bodies [kg].
        budget_global: evaluations per run of the global algorithm.
        budget_local: evaluations per round of the local algorithm.

    Raises:
        OptionError: when an algorithm does not exist, or runs, rounds, bounds or the range of mass make no sense.
        ValueError: when the prior does not have the labels of the base map.

    Source: Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca, IEEE RA-L 4(4), 2019, Algorithm 1.
    """
    if runs < 1 or rounds < 1:
        raise OptionError(f"{runs} runs of {rounds} rounds were asked for; ask for at least 1 of each")
    if total_mass is not None and not 0 <= total_mass[0] <= total_mass[1]:
        raise OptionError(f"total_mass is {total_mass}; expected (least, largest) in kg, neither negative")
    box = bounds_around(base, estimate, prior) if bounds is None else bounds
    if len(box.lower) != len(base.labels):
        raise OptionError(
            f"the bounds are over {len(box.lower)} parameters; expected the {len(base.labels)} of the map"
        )
    game = _game(base, estimate, box, physics_of(base, estimate, prior, total_mass))
    rng, search = np.random.default_rng(seed), OPTIMISERS["nlopt"].minimise
    results: list[tuple[Run, Array]] = []
    for k in range(runs):
        start = game.problem(rng.uniform(size=len(box.lower)), 0.0)
        found = search(start, algorithm=global_algorithm, budget_evaluations=budget_global, seed=seed + k)
        spent, weight = found.evaluations, 0.0
        for i in range(rounds + _MORE):
            if i >= rounds and game.is_feasible(found.x):
                break
            weight = schedule * i if i < rounds else 10 * max(weight, schedule)
            problem = game.problem(found.x, weight)
            found = search(problem, algorithm=local_algorithm, budget_evaluations=budget_local, seed=seed + k)
            spent += found.evaluations
        results.append((game.judged(found.x, weight, spent), found.x))
    best = min(range(runs), key=lambda k: (not results[k][0].feasible, results[k][0].cost))
    (run, z), table = results[best], tuple(result[0] for result in results)
    notes = _notes(run, z, base.labels)
    return Retrieval(game.parameters(z), run, table, global_algorithm, local_algorithm, seed, notes)


@dataclass(frozen=True, eq=False)
class _Game(Frozen):
    """Cost over the unit cube that the box is mapped to."""

    base: BaseMap
    estimate: Estimate
    matrix: Array  # (r, p)
    target: Array  # (r,)
    box: Bounds
    physics: Physics

    def standard(self, z: Array) -> Array:
        return self.box.lower + (self.box.upper - self.box.lower) * z

    def parameters(self, z: Array) -> Parameters:
        return Parameters(self.base.labels, self.standard(z))

    def is_feasible(self, z: Array) -> bool:
        return self.parameters(z).is_feasible()

    def problem(self, z: Array, weight: float) -> Problem:
        """From z on, with a penalty of that weight."""
        width = self.box.upper - self.box.lower

        def cost(z: Array) -> float:
            misfit = float(np.sum((self.matrix @ z - self.target) ** 2))
            return misfit + (weight * self.physics.violation(self.standard(z))[0] if weight else 0.0)

        def gradient(z: Array) -> Array:
            slope = 2 * self.matrix.T @ (self.matrix @ z - self.target)
            return slope + (weight * width * self.physics.violation(self.standard(z))[1] if weight else 0.0)

        return Problem(cost, np.zeros(len(z)), np.ones(len(z)), z, gradient)

    def judged(self, z: Array, weight: float, spent: int) -> Run:
        """What came out, by tests of our own."""
        x, last = self.standard(z), self.problem(z, weight)
        assert last.gradient is not None, "given above"
        away = self.base.combination @ x - self.estimate.value
        chi2 = max(float(away @ self.estimate.information @ away), 0.0)
        cost = last.objective(z)
        in_sight = float(np.abs(np.clip(z - last.gradient(z), 0.0, 1.0) - z).max(initial=0.0))
        converged = in_sight <= _SETTLED + 1e-6 * cost
        return Run(cost, chi2, self.physics.violation(x)[0], self.is_feasible(z), converged, spent)


def _game(base: BaseMap, estimate: Estimate, box: Bounds, physics: Physics) -> _Game:
    root = information_root(estimate.information)
    matrix = root @ base.combination * (box.upper - box.lower)
    left, sharpness, right = np.linalg.svd(matrix, full_matrices=False)
    eased = np.minimum(1.0, _SHARPEST / np.maximum(sharpness, 1e-300))
    target = left.T @ (root @ (estimate.value - base.combination @ box.lower))
    return _Game(base, estimate, (eased * sharpness)[:, None] * right, eased * target, box, physics)


def _notes(run: Run, z: Array, labels: tuple[Label, ...]) -> tuple[str, ...]:
    edge = [label.name for label, at in zip(labels, z, strict=True) if at in (0.0, 1.0)]
    notes = []
    if not run.converged:
        notes.append(f"the search did not converge within {run.evaluations} evaluations; give it more, or fit by cone")
    if not run.feasible:
        notes.append("no real robot could have these parameters: the search found none in the box that one could")
    if edge:
        more = " ..." if len(edge) > 5 else ""
        notes.append(f"on an edge of the box, which may be too narrow: {', '.join(edge[:5])}{more}")
    return tuple(notes)
