"""Model -> optimal exciting motion: the search, and the scale at which a motion obeys all limits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...deadline import ends_in_time
from ...effects import EFFECT_NAMES
from ...errors import OptionError
from ...model import ModelSource, as_model, torque_model
from ...optimisers import OPTIMISERS, Optimum, Problem
from ...regression.motion import Motion
from ...typed import typed
from ...types import Array, Frozen, Progress, Trajectory
from .families import (
    FAMILIES,
    Family,
    at_rate,
    check_duration,
    check_rows,
    column_sizes,
    combine_basis,
    fit_inside,
    random_parameters,
    steady,
)
from .limits import Limits, build_limits
from .problem import Excitation, ExcitationProblem, budget_notes, build_design, usual_laws

MOTION_SEARCH = "the search for a motion"
SCALING_STEP = 0.01  # [s] grid on which motions are scaled to their limits
DESIGN_ALGORITHM = "LD_SLSQP"  # continues at kinks of the cost (contact, reversals), where LD_LBFGS fails
Z_BOUND = 2.5  # [1] bound of z; a parameter alone meets a limit at 1
EXTRA_GAP = 0.02  # [m] extra clearance, since the search uses few samples
LAST_PENALTY_FACTOR = 30.0  # [1] factor on the penalty in the last stage
LIMIT_CHECK_STEP = 1e-3  # [s] grid on which limits are checked
CLEARANCE_CHECK_STEP = 5e-3  # [s] grid on which distances between links are checked
FIRST_CHECK_MULTIPLE = 100  # [multiples of LIMIT_CHECK_STEP] grid of a first check of these distances
SCALE_HALVINGS = 8  # bisection steps of the scale of the motion
LIMIT_ROUNDING = 1e-9  # [1] rounding of a share of a limit
RANDOM_KIND = "random"  # kind of motion without a search
MIN_CLEARANCE = 0.01  # [m] smallest distance between links
MAX_HARMONIC_PERIODS = 500  # largest number of periods of the fastest harmonic
SAMPLES_PER_PERIOD = 12  # samples of the search per period of the fastest harmonic
MIN_UNFLAGGED_SCALE = 0.95  # [1] scale of the motion that keeps all limits, below which it is flagged
PENALTY = 100.0  # [1] on the mean square excess over a limit; the criterion is the log of a standard deviation
SLOW_SHARE = 0.03  # [1] speed over its limit below which the direction of friction is smooth, for a gradient
MIN_EIGENVALUE_SHARE = 1e-13  # [1] smallest eigenvalue over the largest; smaller ones are zero up to rounding
MEAN_POWER = 4  # power of the power means that smooth the extreme eigenvalues
Criterion = Callable[[Array], tuple[float, Array]]
Point = tuple[float, Motion, Array, list[Array]]  # cost; motion; its gradients by states, but for rows, and by rows


@dataclass(frozen=True)
class Budget:
    """Evaluations of each stage of a search."""

    pool: int = 60  # random motions
    starts: int = 8  # local searches from the best of these
    short: int = 30  # evaluations of each of them
    long: int = 250  # evaluations of the search from the best result
    firm: int = 250  # evaluations of the last stage, with firm limits

    @property
    def total(self) -> int:
        return self.pool + self.starts * self.short + self.long + self.firm


@dataclass(frozen=True, eq=False)
class FoundMotion(Frozen):
    """Result of a search."""

    x: Array  # (n, d) [rad or m] parameters
    evaluations: int
    spent: bool  # whether the budget ended the search before an optimum


def search_motion(cost: ExcitationCost, budget: Budget, seed: int, progress: Progress | None = None) -> FoundMotion:
    """Search for the motion of least cost; the last stage has firm penalties, so that limits are nearly obeyed.

    The global stage are local searches from the best random motions. In 63 dimensions and 500 evaluations NLopt's
    GN_CRS2_LM found nothing better than the best of 60 random motions.

    Source: multi-start as in Rinnooy Kan, Timmer, Mathematical Programming 39, 1987.
    """
    watched = _WatchedSearch(cost, budget, progress)
    rng, limits = np.random.default_rng(seed), cost.problem.limits
    fine = cost.family.basis(np.arange(0, cost.t[-1], SCALING_STEP))
    pool = [np.clip(cost.relative(random_parameters(fine, limits, rng)), -Z_BOUND, Z_BOUND) for _ in range(budget.pool)]
    ranked = sorted(pool, key=watched.value)
    tried = [watched.improve(z, budget.short, "searching") for z in ranked[: budget.starts]]
    best = watched.improve(min(tried, key=lambda end: end.value).x, budget.long, "improving")
    settled = enforce_limits(cost, cost.parameters(best.x), budget, progress)
    spent = settled.spent or best.status == "budget"
    return FoundMotion(settled.x, watched.count + settled.evaluations, spent)


def enforce_limits(cost: ExcitationCost, x: Array, budget: Budget, progress: Progress | None = None) -> FoundMotion:
    """Last stage of a search, from x (n, d) [rad or m]: minimise the cost with firm penalties."""
    firm = replace(cost, penalty=LAST_PENALTY_FACTOR * cost.penalty)
    watched = _WatchedSearch(firm, budget, progress, budget.total - budget.firm)
    best = watched.improve(np.clip(cost.relative(x), -Z_BOUND, Z_BOUND), budget.firm, "settling")
    fine = cost.family.basis(np.arange(0, cost.t[-1], SCALING_STEP))
    x = fit_inside(fine, cost.problem.limits, cost.parameters(best.x))
    return FoundMotion(x, watched.count, best.status == "budget")


class _WatchedSearch:
    """Cost that counts evaluations and reports progress."""

    def __init__(self, cost: ExcitationCost, budget: Budget, progress: Progress | None, before: int = 0) -> None:
        self.cost, self.budget, self.progress = cost, budget, progress
        self.count, self.before, self.stage = 0, before, "drawing"

    def improve(self, z: Array, evaluations: int, stage: str) -> Optimum:
        """Best point of a local search from z (d,) [1]."""
        box, self.stage = np.full(len(z), Z_BOUND), stage
        problem = Problem(self.value, -box, box, steady(z), self.slope, MOTION_SEARCH)
        return OPTIMISERS["nlopt"].minimise(problem, algorithm=DESIGN_ALGORITHM, budget_evaluations=evaluations)

    def value(self, z: Array) -> float:
        """Cost of z (d,) [1]."""
        self.count += 1
        if self.progress is not None:
            self.progress(f"{self.stage} motions", min(1.0, (self.before + self.count) / self.budget.total))
        return float(steady(np.array(self.cost.value(z))))

    def slope(self, z: Array) -> Array:
        """Gradient (d,) [1] of the cost at z (d,) [1]."""
        return steady(self.cost.value_and_slope(z)[1])


class FeasibleMotion(NamedTuple):
    """Motion within the limits."""

    x: Array  # (n, d) [rad or m] parameters
    share: float  # [1] scale of the motion about the home posture
    distance: float | None  # [m] smallest distance between links


def make_feasible(problem: ExcitationProblem, family: Family, x: Array) -> FeasibleMotion:
    """Scale a motion of parameters x (n, d) [rad or m] by as little as needed to obey all limits.

    Each joint is scaled to its position, velocity and acceleration limits. If torque or the distance between links
    exceeds a limit, the whole motion shrinks towards the home posture.

    Raises:
        OptionError: even a small motion exceeds a torque limit.
    """
    t = time_grid(family.duration, LIMIT_CHECK_STEP)
    full = fit_inside(family.basis(t), problem.limits, x)
    home = np.zeros_like(full)
    home[:, 0] = problem.home
    best, high, share = FeasibleMotion(home, 0.0, None), 1.0, 1.0
    for _ in range(SCALE_HALVINGS):
        tried = home + share * (full - home)
        ok, distance = _obeys_limits(problem, family, t, tried)
        best, high = (FeasibleMotion(tried, share, distance), high) if ok else (best, share)
        if best.share == high:
            break
        share = (best.share + high) / 2
    if best.share == 0.0:
        raise OptionError("even a small motion exceeds a torque limit; raise the limit, or state lower friction")
    return best


def time_grid(duration: float, step: float = LIMIT_CHECK_STEP) -> Array:
    """Instants (N,) [s] from 0 to the duration [s], at most a step [s] apart."""
    return np.linspace(0, duration, int(np.ceil(duration / step)) + 1)


def _obeys_limits(problem: ExcitationProblem, family: Family, t: Array, x: Array) -> tuple[bool, float | None]:
    """Whether a motion obeys all limits, and the smallest distance between links [m], None without their shapes."""
    shapes, clearance = problem.collision, problem.clearance
    if shapes is not None:  # a coarse grid shows most collisions
        if shapes.distance(family.basis(t[::FIRST_CHECK_MULTIPLE])[0] @ x.T).min() < clearance:
            return False, None
    use = problem.use(family.sample(problem.model.robot.joints, x, t))
    if use.largest > problem.limits.margin + LIMIT_ROUNDING:
        return False, None
    if shapes is None:
        return True, None
    distance = float(shapes.distance(family.basis(time_grid(float(t[-1]), CLEARANCE_CHECK_STEP))[0] @ x.T).min())
    return distance >= clearance, distance


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
    clearance: float = MIN_CLEARANCE,
    rate: float = 100.0,
    budget: Budget | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Excitation:
    """Optimal exciting motion: most information on the base parameters of bodies and laws within the limits.

    >>> signid.excite("3r", kind="random", duration=5.0).trajectory.q.shape
    (501, 3)

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
    _check_options(kind, criterion, rate, duration, harmonics, frequency)
    family = FAMILIES["fourier" if kind == RANDOM_KIND else kind](duration, harmonics, frequency)
    limits = limits or build_limits(model.robot)
    problem, notes = build_design(model, usual_laws(model, effects), family, limits, clearance, seed)
    steps = int(np.ceil(SAMPLES_PER_PERIOD * harmonics * frequency * duration))
    cost = ExcitationCost(problem, CRITERIA[criterion], family, np.linspace(0, duration, steps + 1), PENALTY, EXTRA_GAP)
    budget = budget or Budget()
    if kind == RANDOM_KIND:
        fine = family.basis(np.arange(0, duration, SCALING_STEP))
        found = FoundMotion(random_parameters(fine, limits, np.random.default_rng(seed)), 1, spent=False)
        feasible = make_feasible(problem, family, found.x)
    else:
        feasible, found = _optimise_motion(cost, budget, seed, progress)
    small = (
        f"the optimised motion was scaled to {feasible.share:.0%} to obey torque limits and distances between links, "
        f"and is no longer optimal; try another seed or a larger budget"
    )
    dense = family.sample(model.robot.joints, feasible.x, time_grid(duration))
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
        use=problem.use(dense),
        distance=feasible.distance,
        seed=seed,
        evaluations=found.evaluations,
        notes=(*model.robot.notes, *limits.notes, *notes, *budget_notes(found.evaluations if found.spent else 0)),
        flags=(small,) if feasible.share < MIN_UNFLAGGED_SCALE and kind != RANDOM_KIND else (),
    )


def _check_options(kind: str, criterion: str, rate: float, duration: float, harmonics: int, frequency: float) -> None:
    if kind not in (kinds := (*FAMILIES, RANDOM_KIND)):
        raise OptionError(f"there is no kind {kind!r} of motion; choose from {', '.join(kinds)}")
    if criterion not in CRITERIA:
        raise OptionError(f"there is no criterion {criterion!r}; choose from {', '.join(CRITERIA)}")
    check_duration(duration, harmonics, frequency)
    if (waves := duration * frequency * harmonics) > MAX_HARMONIC_PERIODS:
        raise OptionError(
            f"{duration:g} s are {waves:.0f} periods of the fastest harmonic, more than {MAX_HARMONIC_PERIODS}; "
            f"give a shorter duration, fewer harmonics or a lower base frequency"
        )
    check_rows(duration, rate)


def _optimise_motion(
    cost: ExcitationCost, budget: Budget, seed: int, progress: Progress | None
) -> tuple[FeasibleMotion, FoundMotion]:
    """Best motion within all limits; if it had to shrink, its last stage is repeated with twice as many instants."""
    found = search_motion(cost, budget, seed, progress)
    feasible = make_feasible(cost.problem, cost.family, found.x)
    if feasible.share == 1:
        return feasible, found
    dense = replace(cost, t=np.linspace(0, cost.family.duration, 2 * len(cost.t) - 1), spare=2 * cost.spare)
    again = enforce_limits(dense, found.x, budget, progress)
    other = make_feasible(cost.problem, cost.family, again.x)
    best = min(feasible, other, key=lambda end: cost.value(cost.relative(end.x)))
    return best, FoundMotion(again.x, found.evaluations + again.evaluations, found.spent or again.spent)


class Precision(NamedTuple):
    """Predicted precision of base parameters."""

    log_det: float  # log of the determinant of the scaled information
    condition: float  # condition number of the scaled base regressor
    std: Array  # (b,) [units of base] standard deviations


def predict_precision(problem: ExcitationProblem, trajectory: Trajectory) -> Precision:
    """Predict the precision of the base parameters from samples of a trajectory."""
    rows = problem.rows(problem.motion(trajectory.t, trajectory.q, trajectory.v, trajectory.a))
    values, vectors = np.linalg.eigh(problem.information(rows))
    values = np.maximum(values, 1e-300)
    std = np.sqrt(np.sum(vectors**2 / values, axis=1)) / problem.size
    return Precision(float(np.sum(np.log(values))), float(np.sqrt(values[-1] / values[0])), std)


def determinant(information: Array) -> tuple[float, Array]:
    """D-optimality of information (b, b) [1]: mean log of the principal standard deviations, and its gradient (b, b).

    Source: Swevers et al., IEEE T-RA 13(5), 1997, section III.
    """
    values, vectors = _spectrum(information)
    return float(-np.mean(np.log(values)) / 2), -(vectors / values) @ vectors.T / (2 * len(values))


def condition(information: Array) -> tuple[float, Array]:
    """Log of the regressor's condition number, from information (b, b) [1], with smoothed extremes; its gradient.

    Source: Gautier, Khalil, Int. J. Robotics Research 11(4), 1992; smoothed by power means of the eigenvalues.
    """
    values, vectors = _spectrum(information)
    large, small = (values / values[-1]) ** MEAN_POWER, (values[0] / values) ** MEAN_POWER
    top, low = large.sum(), small.sum()
    cost = (np.log(values[-1] / values[0]) + np.log(top * low) / MEAN_POWER) / 2
    slope = (large / top - small / low) / values / 2
    return float(cost), (vectors * slope) @ vectors.T


CRITERIA: dict[str, Criterion] = {"determinant": determinant, "condition": condition}


def _spectrum(information: Array) -> tuple[Array, Array]:
    values, vectors = np.linalg.eigh(information)
    return np.maximum(values, MIN_EIGENVALUE_SHARE * max(values[-1], 1e-300)), vectors


@dataclass(frozen=True, eq=False)
class ExcitationCost(Frozen):
    """Cost of a motion with scaled parameters z (n * d,) [1]: mean position relative to the middle, then the rest."""

    problem: ExcitationProblem
    criterion: Criterion
    family: Family
    t: Array  # (N,) [s] samples at which the cost is computed
    penalty: float  # [1] weight of the mean square relative excess over a limit
    spare: float  # [m] extra distance between links, beyond the clearance

    @cached_property
    def basis(self) -> Array:
        """Basis (3, N, d) [1, 1/s, 1/s2] at the samples."""
        return self.family.basis(self.t)

    @cached_property
    def sizes(self) -> Array:
        """Parameters (n, d) [rad or m] at z = 1."""
        sizes = column_sizes(self.basis, self.problem.limits)
        sizes[:, 0] = self.problem.limits.half
        return sizes

    @cached_property
    def _latest(self) -> dict[bytes, Point]:  # a search asks for the value, then for the slope
        return {}

    def parameters(self, z: Array) -> Array:
        """Parameters (n, d) [rad or m] from z (n * d,) [1]."""
        x = z.reshape(self.sizes.shape) * self.sizes
        x[:, 0] += self.problem.limits.middle
        return x

    def relative(self, x: Array) -> Array:
        """Scaled parameters z (n * d,) [1] from x (n, d) [rad or m]."""
        y = x.copy()
        y[:, 0] -= self.problem.limits.middle
        return (y / self.sizes).ravel()

    def value(self, z: Array) -> float:
        """Cost of z (n * d,) [1]."""
        return self._at(z)[0]

    def value_and_slope(self, z: Array) -> tuple[float, Array]:
        """Cost of z (n * d,) [1], and its gradient (n * d,) [1]."""
        value, motion, by_state, weights = self._at(z)
        by_state = by_state + self.problem.row_slopes(motion, weights)
        return value, (np.einsum("kid,kij->jd", self.basis, by_state) * self.sizes).ravel()

    def _at(self, z: Array) -> Point:
        if (key := z.tobytes()) not in self._latest:
            self._latest.clear()
            problem, count = self.problem, len(self.t)
            states = combine_basis(self.basis, self.parameters(z))
            slow = SLOW_SHARE * problem.limits.velocity
            motion = problem.motion(self.t, states[0], states[1], states[2], slow)
            rows = problem.rows(motion)
            cost, slope = self.criterion(problem.information(rows) / count)
            (excess, by_state), (overload, by_load) = self._excess(states), self._overload(rows)
            if problem.collision is not None:
                contact, by_place = problem.collision.penalty(states[0], problem.clearance, self.spare)
                excess, by_state[0] = excess + contact, by_state[0] + by_place
            weights = [
                2 / count * x @ slope[np.ix_(seen, seen)] + self.penalty * load
                for x, seen, load in zip(rows, problem.base.sees, by_load, strict=True)
            ]
            value = cost + self.penalty * (excess + overload)
            self._latest[key] = value, motion, self.penalty * by_state, weights
        return self._latest[key]

    def _excess(self, states: Array) -> tuple[float, Array]:
        """Mean square excess over position, velocity and acceleration limits; gradient (3, N, n)."""
        limits = self.problem.limits
        share = limits.shares(*states)
        over = share - np.clip(share, -1, 1)
        return float(np.sum(over**2)) / len(self.t), 2 * over / limits.allowed[:, None] / len(self.t)

    def _overload(self, rows: Sequence[Array]) -> tuple[float, list[Array]]:
        """Mean square excess over torque limits; gradient (N, m_j) per joint."""
        total, slopes, problem = 0.0, [], self.problem
        for j, (x, seen) in enumerate(zip(rows, problem.base.sees, strict=True)):
            per_row = problem.value[seen] * problem.size[seen] * problem.noise[j]
            share = x @ per_row / (problem.limits.torque[j] * problem.limits.margin)
            over = share - np.clip(share, -1, 1)
            total += float(np.sum(over**2)) / len(self.t)
            scale = 2 / (problem.limits.torque[j] * problem.limits.margin) / len(self.t)
            slopes.append(np.outer(over * scale, per_row))
        return total, slopes
