"""Model -> optimal exciting motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...deadline import ends_in_time
from ...effects import EFFECT_NAMES
from ...errors import OptionError
from ...model import ModelSource, as_model, torque_model
from ...typed import typed
from ...types import Array, Progress, Trajectory
from .cost import CRITERIA, ExcitationCost
from .families import FAMILIES
from .limits import Limits, build_limits
from .problem import ExcitationProblem, build_problem, usual_laws
from .random_motions import at_rate, check_duration, check_rows, random_parameters
from .result import Excitation, budget_notes
from .search import GRID, SPARE, Budget, FeasibleMotion, FoundMotion, enforce_limits, grid, make_feasible, search

RANDOM = "random"  # kind of motion without a search
CLEARANCE = 0.01  # [m] smallest distance between links
WAVES = 500  # largest number of periods of the fastest harmonic
PER_PERIOD = 12  # samples of the search per period of the fastest harmonic
KEPT = 0.95  # [1] scale of the motion that keeps all limits, below which it is flagged
PENALTY = 100.0  # [1] on the mean square excess over a limit; the criterion is the log of a standard deviation


@typed
@ends_in_time
def excite(
    model: ModelSource,
    *,
    kind: str = "fourier",
    criterion: str = "determinant",
    duration: float = 20.0,
    harmonics: int = 10,
    base_frequency: float | None = None,
    limits: Limits | None = None,
    effects: Sequence[str] = EFFECT_NAMES,
    clearance: float = CLEARANCE,
    rate: float = 100.0,
    budget: Budget | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Excitation:
    """Optimal exciting motion: most information on the base parameters of bodies and laws within the limits.

    The motion is at rest at both ends. The assumed torque noise is 1 % of each joint's torque limit; for joints without
    a limit, 1 % of the rms torque along random motions. Limits are obeyed on a grid of 1 ms, distances between links on
    one of 5 ms. The motion is the same on every processor (`steady`), but not with other versions of the libraries.

    Args:
        model: robot, inertials and laws as known so far; they give the torque.
        kind: "fourier", "spline", or "random": one random Fourier series, scaled to the limits, without a search.
        criterion: "determinant" of the information (D-optimality) or "condition" number of the base regressor.
        duration: duration of the motion [s].
        harmonics: number of harmonics of the base frequency; a spline gets as many degrees of freedom.
        base_frequency: base frequency [Hz]; None: one period in the duration.
        limits: limits by `build_limits`; None: limits of the description.
        effects: laws at every joint whose coefficients are to be identified as well.
        clearance: smallest distance between links [m].
        rate: sampling rate of the result [Hz].
        budget: evaluations of each stage of the search.
        seed: seed of all random numbers.
        progress: function that is called with the current step and the share of it that is done.

    Raises:
        OptionError: an option is unknown, a limit leaves no motion, or the duration is shorter than a period.
    """
    model = torque_model(as_model(model, "excite"))
    frequency = 1 / duration if base_frequency is None and duration > 0 else base_frequency or 0.0
    _check(kind, criterion, rate, duration, harmonics, frequency)
    family = FAMILIES["fourier" if kind == RANDOM else kind](duration, harmonics, frequency)
    limits = limits or build_limits(model.robot)
    problem, notes = build_problem(model, usual_laws(model, effects), family, limits, clearance, seed)
    instants = int(np.ceil(PER_PERIOD * harmonics * frequency * duration))
    cost = ExcitationCost(problem, CRITERIA[criterion], family, np.linspace(0, duration, instants + 1), PENALTY, SPARE)
    budget = budget or Budget.usual(len(model.robot.joints))
    feasible, found = (_random if kind == RANDOM else _optimised)(cost, budget, seed, progress)
    small = (
        f"the optimised motion was scaled to {feasible.share:.0%} to obey torque limits and distances between links, "
        f"and is no longer optimal; try another seed or a larger budget"
    )
    fine = family.sample(model.robot.joints, feasible.x, grid(duration))
    trajectory = family.sample(model.robot.joints, feasible.x, at_rate(duration, rate))
    precision = predict_precision(problem, trajectory)
    return Excitation(
        trajectory=trajectory,
        kind=kind,
        criterion=criterion,
        value=precision.log_det if criterion == "determinant" else precision.condition,
        log_det=precision.log_det,
        condition=precision.condition,
        expressions=problem.base.expressions,
        std=precision.std,
        relative_std=precision.std / np.where(problem.value, np.abs(problem.value), np.nan),
        noise=problem.noise,
        use=problem.use(fine),
        distance=feasible.distance,
        seed=seed,
        evaluations=found.evaluations,
        notes=(*model.robot.notes, *limits.notes, *notes, *budget_notes(found.evaluations if found.spent else 0)),
        flags=(small,) if feasible.share < KEPT and kind != RANDOM else (),
    )


def _check(kind: str, criterion: str, rate: float, duration: float, harmonics: int, frequency: float) -> None:
    if kind not in (kinds := (*FAMILIES, RANDOM)):
        raise OptionError(f"there is no kind {kind!r} of motion; choose from {', '.join(kinds)}")
    if criterion not in CRITERIA:
        raise OptionError(f"there is no criterion {criterion!r}; choose from {', '.join(CRITERIA)}")
    check_duration(duration, harmonics, frequency)
    if (waves := duration * frequency * harmonics) > WAVES:
        raise OptionError(
            f"{duration:g} s are {waves:.0f} periods of the fastest harmonic, more than {WAVES}; "
            f"give a shorter duration, fewer harmonics or a lower base frequency"
        )
    check_rows(duration, rate)


def _random(
    cost: ExcitationCost, budget: Budget, seed: int, progress: Progress | None
) -> tuple[FeasibleMotion, FoundMotion]:
    """Random motion within all limits."""
    fine = cost.family.basis(np.arange(0, cost.family.duration, GRID))
    x = random_parameters(fine, cost.problem.limits, np.random.default_rng(seed))
    return make_feasible(cost.problem, cost.family, x), FoundMotion(x, 1, spent=False)


def _optimised(
    cost: ExcitationCost, budget: Budget, seed: int, progress: Progress | None
) -> tuple[FeasibleMotion, FoundMotion]:
    """Best motion within all limits; if it had to shrink, its last stage is repeated with twice as many instants."""
    found = search(cost, budget, seed, progress)
    feasible = make_feasible(cost.problem, cost.family, found.x)
    if feasible.share == 1:
        return feasible, found
    dense = replace(cost, t=np.linspace(0, cost.family.duration, 2 * len(cost.t) - 1), spare=2 * cost.spare)
    again = enforce_limits(dense, found.x, budget, progress)
    other = make_feasible(cost.problem, cost.family, again.x)
    best = min(feasible, other, key=lambda end: cost.value(cost.relative(end.x)))
    spent = found.spent or again.spent
    return best, FoundMotion(again.x, found.evaluations + again.evaluations, spent)


class Precision(NamedTuple):
    """Predicted precision of base parameters."""

    log_det: float  # log of the determinant of the scaled information
    condition: float  # condition number of the scaled base regressor
    std: Array  # (b,) [units of base] standard deviations


def predict_precision(problem: ExcitationProblem, trajectory: Trajectory) -> Precision:
    """Predict the precision of the base parameters from samples of a trajectory."""
    rows = problem.rows(trajectory.t, trajectory.q, trajectory.v, trajectory.a)
    values, vectors = np.linalg.eigh(problem.information(rows))
    values = np.maximum(values, 1e-300)
    std = np.sqrt(np.sum(vectors**2 / values, axis=1)) / problem.size
    return Precision(float(np.sum(np.log(values))), float(np.sqrt(values[-1] / values[0])), std)
