"""Motion along which two laws differ most."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from ...deadline import ends_in_time
from ...effects import EFFECTS
from ...effects.law import candidate_places, law_columns, law_torque
from ...errors import OptionError
from ...model import Model, ModelSource, as_model, torque_model
from ...optimisers import OPTIMISERS, Problem
from ...regression.motion import Motion
from ...regression.projection import leave
from ...regression.rows import away_from_reversals
from ...typed import typed
from ...types import Array, Frozen, Law, Progress, Trajectory
from .design import EXTRA_GAP, MIN_CLEARANCE, MOTION_SEARCH, make_feasible, time_grid
from .families import (
    Family,
    Fourier,
    at_rate,
    check_duration,
    check_rows,
    column_sizes,
    fit_inside,
    random_parameters,
    steady,
)
from .limits import Limits, build_limits
from .problem import DIRECTION_SPEED, MIN_LAMBDA, ExcitationProblem, Separation, budget_notes, build_design, usual_laws

INDEPENDENT_RATE = 20.0  # [Hz] rate of torque samples with independent errors, after filters
NEAR_TIME = 0.06  # [s] before and after a reversal in which torque does not count
EQUAL_LAW_SHARE = 1e-6  # [1] of a law's sum of squares: the laws are equal up to rounding and linearisation
MEMORY_RATE = 100.0  # [Hz] of the motion if a law has memory
BASE_PERIODS = (1, 2, 4, 12)  # base frequencies of the families, in periods per duration
POOL_MOTIONS, IMPROVED_MOTIONS, MAX_EVALUATIONS = 60, 4, 120  # random; best ones of these; evaluations for each
POOL_LIMIT_SHARES = (0.1, 1.0)  # [1] smallest and largest share of the limits that a random motion uses
MAX_PARAMETER_CHANGE = 0.5  # [1] largest change of a parameter, as a share of the value at which it alone meets a limit
PAIR_ALGORITHM = "LN_SBPLX"
CLEARANCE_SAMPLES = 50  # samples at which distances between links are computed
LIMIT_PENALTY = 1e3  # [1] on the mean square excess over a limit; the objective is the log of a distance
MIN_DISTANCE = 1e-30  # [1] smallest distance, since the log of zero is infinite


class Distance(NamedTuple):
    """Distance of two laws, for either of them being the true one."""

    seen: tuple[float, float]  # lambda [1]: first law true and second fitted, second true and first fitted
    shares: tuple[float, float]  # [1] of the true law's own sum of squares over noise


@dataclass(frozen=True, eq=False)
class LawPair(Frozen):
    """Two laws, and the nuisance that is fitted besides either of them."""

    problem: ExcitationProblem  # its laws and bodies are the nuisance
    first: Law
    second: Law
    bodies: bool  # whether the bodies' base parameters are fitted too

    def distance(self, trajectory: Trajectory) -> Distance:
        """Distance along a uniformly sampled trajectory."""
        motion = with_torque(self.problem.model, trajectory)
        nuisance, noise = self._nuisance(motion, trajectory), self.problem.noise
        there = law_distance(self.first, self.second, motion, nuisance, noise)
        back = law_distance(self.second, self.first, motion, nuisance, noise)
        return Distance((there[0], back[0]), (there[1], back[1]))

    def _nuisance(self, motion: Motion, trajectory: Trajectory) -> Array:
        """(N, n, k) columns that are fitted besides either law [N.m or N per unit of each]."""
        if not self.bodies:
            return wide_columns(self.problem.laws, motion)
        rows = self.problem.rows(self.problem.motion(trajectory.t, trajectory.q, trajectory.v, trajectory.a))
        out = np.zeros((*motion.q.shape, self.problem.base.rank))
        for j, (x, seen) in enumerate(zip(rows, self.problem.base.sees, strict=True)):
            out[:, j, seen] = x * self.problem.noise[j]
        return out


def law_distance(law: Law, rival: Law, motion: Motion, nuisance: Array, noise: Array) -> tuple[float, float]:
    """Sum of squares over noise of a law's torque that a rival and the nuisance cannot explain, and its share.

    If one of the laws jumps with the direction of a joint's motion, samples near its reversals do not count, as in
    identification: dry friction is uncertain there. Parameters that the law does not state take the example values of
    its effect. Shapes that the rival does not state are tried on their grid. The N samples of the motion are uniform
    and have the predicted torque. The columns nuisance (N, n, k) [N.m or N per unit of each] are fitted besides. The
    sum [1], over noise (n,) [N.m or N], is for independent samples at 20 Hz; its share [1] is of the law's own.

    Source: T-optimality, Atkinson, Fedorov, Biometrika 62(1), 1975.
    """
    at = list({j for acting in (law, rival) if acting.effect.reverses for j in acting.joints})
    sign = np.sign(motion.v)  # a reversal may lie between two samples
    speed = np.where(np.diff(sign, axis=0, append=sign[-1:]) != 0, 0.0, motion.v)
    certain = np.ones(motion.v.shape, dtype=bool)
    certain[:, at] = away_from_reversals(speed[:, at], round(NEAR_TIME / motion.dt), np.full(len(at), DIRECTION_SPEED))
    weight = certain / noise
    stated = Law(law.effect, law.joints, {**law.effect.example, **law.parameters})
    rows, torque = law_torque(stated, motion)
    wide = np.zeros_like(motion.q)
    wide[:, list(rows)] = torque
    y = (wide * weight).ravel()
    whole = float(y @ y)
    candidates = (np.concatenate([nuisance, wide_columns([one], motion)], axis=2) for one in _law_shapes(rival, motion))
    rests = (leave(y, (x * weight[:, :, None]).reshape(len(y), -1)) for x in candidates)
    left = min(float(rest @ rest) for rest in rests)
    return INDEPENDENT_RATE * motion.dt * left, left / whole if whole > 0 else 0.0


def wide_columns(laws: Sequence[Law], motion: Motion) -> Array:
    """Columns (N, n, k) of laws over all joints [N.m or N per unit of each], zero where a law does not act."""
    parts = [np.zeros((*motion.q.shape, 0))]
    for law in laws:
        rows, columns = law_columns(law, motion)
        out = np.zeros((*motion.q.shape, columns.shape[2]))
        out[:, list(rows)] = columns
        parts.append(out)
    return np.concatenate(parts, axis=2)


def with_torque(model: Model, trajectory: Trajectory) -> Motion:
    """Motion with the torque that a model predicts, for laws that act on torque."""
    t, q, v, a = trajectory.t, trajectory.q, trajectory.v, trajectory.a
    slow = np.full(q.shape[1], DIRECTION_SPEED)
    torque = model.inverse(Motion(model.robot, t, q, v, a, slow=slow))
    return Motion(model.robot, t, q, v, a, recorded=torque, predicted=torque, slow=slow)


def _law_shapes(law: Law, motion: Motion) -> Iterator[Law]:
    """The law as it stands if it states its shape, else the law with each shape on the grid of its effect."""
    if law.effect.shape(law.parameters).keys() == law.effect.parameters.keys() - law.effect.linear().keys():
        yield law
    else:
        for shape in law.effect.shapes(motion.at(law.joints)):
            yield Law(law.effect, law.joints, shape)


@typed
@ends_in_time
def separate(
    model: ModelSource,
    first: Law,
    second: Law,
    *,
    nuisance: Literal["friction", "bodies"] = "friction",
    duration: float = 20.0,
    harmonics: int = 5,
    limits: Limits | None = None,
    clearance: float = MIN_CLEARANCE,
    rate: float = 100.0,
    seed: int = 0,
    progress: Progress | None = None,
) -> Separation:
    """Motion along which two laws differ most, whichever is true, while the other law and the nuisance are fitted.

    The distance is the sum of squares, over the noise (as in `excite`, for 20 independent samples per second), of the
    torque of one law that the other law and the nuisance cannot explain. Random Fourier motions of random centre and
    size are evaluated, and the best ones improved. Parameters that the true law does not state take the example values
    of its effect. The other law is fitted: its coefficients, and its shapes on their grid unless it states them.

    Args:
        model: robot, inertials and laws as known so far.
        first: law at its joints.
        second: other law.
        nuisance: "friction" (viscous, Coulomb, offset at every joint; inertials are known) or "bodies" (these as well).
        duration: duration of the motion [s].
        harmonics: number of harmonics of its series.
        limits: limits by `build_limits`; None: limits of the description.
        clearance: smallest distance between links [m].
        rate: sampling rate of the result [Hz].
        seed: seed of all random numbers.
        progress: function that is called with the current step and the share of it that is done.

    Raises:
        OptionError: the laws are equal or cannot act there, an option is unknown, or a limit leaves no motion.

    Source: T-optimality, Atkinson, Fedorov, Biometrika 62(1), 1975.
    """
    model = torque_model(as_model(model, "separate"))
    for law in (first, second):
        if law.joints not in candidate_places(law.effect, len(model.robot.joints)):
            raise OptionError(
                f"{law.effect.name} cannot act at joints {law.joints} of {model.robot.name}; choose from "
                f"{candidate_places(law.effect, len(model.robot.joints))[:8]}, counted from 0"
            )
    if (first.effect.name, first.joints) == (second.effect.name, second.joints):
        raise OptionError(f"both laws are {first.effect.name} at the same joints; give two that differ")
    if nuisance not in ("friction", "bodies"):
        raise OptionError(f"there is no nuisance {nuisance!r}; choose from friction, bodies")
    check_duration(duration, harmonics, 1 / duration if duration > 0 else 0.0)
    check_rows(duration, rate)
    limits = limits or build_limits(model.robot)
    families = [Fourier(duration, harmonics, periods / duration) for periods in BASE_PERIODS]
    usual = [effect.name for effect in EFFECTS if effect.usual]
    rivals = {(law.effect.name, law.joints) for law in (first, second)}
    laws = tuple(law for law in usual_laws(model, usual) if (law.effect.name, law.joints) not in rivals)
    problem, notes = build_design(model, laws, families[0], limits, clearance, seed)
    density = MEMORY_RATE if any(law.effect.memory for law in (first, second)) else INDEPENDENT_RATE
    pair = LawPair(problem, first, second, nuisance == "bodies")
    search = _MotionSearch(pair, at_rate(duration, density), families, seed, progress)
    pool = search.random_pool()
    ways = tuple(way for way in (0, 1) if max(candidate.distance.shares[way] for candidate in pool) > EQUAL_LAW_SHARE)
    ends = search.improve(pool, ways) if ways else [max(pool, key=lambda candidate: float(np.ptp(candidate.x[:, 1:])))]
    feasible = [(end.family, make_feasible(problem, end.family, end.x)) for end in ends]
    family, best = max(feasible, key=lambda end: search.objective(end[0], end[1].x, ways))
    distance = search.distance(family, best.x)
    evaluated = (len(pool) + sum(end.evaluations for end in ends)) * any(end.spent for end in ends)
    fine = family.sample(model.robot.joints, best.x, time_grid(duration))
    return Separation(
        trajectory=family.sample(model.robot.joints, best.x, at_rate(duration, rate)),
        laws=(first, second),
        distances=distance.seen,
        shares=distance.shares,
        median=float(np.median([search.smaller(candidate.distance, ways) for candidate in pool])),
        structural=not ways,
        noise=problem.noise,
        use=problem.use(fine),
        distance=best.distance,
        seed=seed,
        notes=(*model.robot.notes, *limits.notes, *notes, *budget_notes(evaluated)),
        flags=_pair_flags(first, second, distance, ways),
    )


def _pair_flags(first: Law, second: Law, distance: Distance, ways: Sequence[int]) -> tuple[str, ...]:
    names = first.effect.name, second.effect.name
    if not ways:
        return (
            f"no motion of {POOL_MOTIONS} distinguishes {names[0]} from {names[1]}: the difference is structural; "
            "use another sensor or a known load",
        )
    if len(ways) == 1:
        general, special = names[ways[0]], names[1 - ways[0]]
        return (
            f"{general} and the nuisance explain everything that {special} can do, on every motion: the laws are "
            f"distinguishable only if {general} is true",
        )
    if min(distance.seen) < MIN_LAMBDA:
        return (
            f"the laws differ by {min(distance.seen):.3g} along the best motion: the result may be ambiguous; "
            f"{MIN_LAMBDA:g} is needed",
        )
    return ()


class _Candidate(NamedTuple):
    """Motion and the distance of the laws along it."""

    family: Family
    x: Array  # (n, d) [rad or m]
    distance: Distance
    evaluations: int = 1  # motions evaluated to find it
    spent: bool = False  # whether the budget ended its search before an optimum


@dataclass(frozen=True, eq=False)
class _MotionSearch(Frozen):
    """Search over motions of some families for a large distance of two laws.

    `ways` are the directions of the distance that count: 0 for the first law true, 1 for the second.
    """

    laws: LawPair
    t: Array  # (N,) [s] samples at which distances are computed
    families: Sequence[Family]
    seed: int
    progress: Progress | None

    def random_pool(self) -> list[_Candidate]:
        """Random motions of random centre and size, scaled to the limits of position, velocity and acceleration."""
        rng, limits, candidates = np.random.default_rng(self.seed), self.laws.problem.limits, []
        for k in range(POOL_MOTIONS):
            family = self.families[k % len(self.families)]
            x = random_parameters(self._bases[id(family)], limits, rng, POOL_LIMIT_SHARES)
            candidates.append(_Candidate(family, x, self.distance(family, x)))
            self._report("drawing motions", k, POOL_MOTIONS)
        return candidates

    def improve(self, pool: Sequence[_Candidate], ways: Sequence[int]) -> list[_Candidate]:
        """The best motions of a pool, improved one after another."""
        ranked = sorted(pool, key=lambda candidate: self.objective(candidate.family, candidate.x, ways), reverse=True)
        return [self._improved(candidate, ways, k) for k, candidate in enumerate(ranked[:IMPROVED_MOTIONS])]

    def distance(self, family: Family, x: Array) -> Distance:
        """Distance of the laws along the motion of parameters x (n, d) [rad or m]."""
        return self.laws.distance(family.sample(self.laws.problem.model.robot.joints, x, self.t))

    def objective(self, family: Family, x: Array, ways: Sequence[int]) -> float:
        """Log of the smaller distance, less penalties on torque and contact; x: (n, d) [rad or m]."""
        problem = self.laws.problem
        motion = family.sample(problem.model.robot.joints, x, self.t)
        torque = problem.model.inverse(Motion(problem.model.robot, motion.t, motion.q, motion.v, motion.a))
        over = np.maximum(np.abs(torque) / (problem.limits.margin * problem.limits.torque) - 1, 0)
        excess = float(np.sum(over**2)) / len(self.t)
        if problem.collision is not None:
            few = motion.q[:: max(1, len(motion.q) // CLEARANCE_SAMPLES)]
            excess += problem.collision.penalty(few, problem.clearance, EXTRA_GAP)[0]
        return float(np.log(max(self.smaller(self.laws.distance(motion), ways), MIN_DISTANCE))) - LIMIT_PENALTY * excess

    def smaller(self, distance: Distance, ways: Sequence[int]) -> float:
        """Smaller one of the distances that count."""
        return min((distance.seen[way] for way in ways), default=0.0)

    def _improved(self, start: _Candidate, ways: Sequence[int], turn: int) -> _Candidate:
        family, limits = start.family, self.laws.problem.limits
        basis, count = self._bases[id(family)], 0
        sizes = column_sizes(basis, limits)
        sizes[:, 0] = limits.half

        def inside(change: Array) -> Array:
            return fit_inside(basis, limits, start.x + change.reshape(sizes.shape) * sizes)

        def cost(change: Array) -> float:
            nonlocal count
            count += 1
            self._report("improving motions", turn * MAX_EVALUATIONS + count, IMPROVED_MOTIONS * MAX_EVALUATIONS)
            return -float(steady(np.array(self.objective(family, inside(change), ways))))

        reach = np.full(sizes.size, MAX_PARAMETER_CHANGE)
        problem = Problem(cost, -reach, reach, np.zeros(sizes.size), search=MOTION_SEARCH)
        best = OPTIMISERS["nlopt"].minimise(problem, algorithm=PAIR_ALGORITHM, budget_evaluations=MAX_EVALUATIONS)
        x = inside(best.x)
        return _Candidate(family, x, self.distance(family, x), best.evaluations, best.status == "budget")

    @cached_property
    def _bases(self) -> dict[int, Array]:
        fine = np.linspace(0, self.t[-1], 1 + 20 * int(self.t[-1] + 1))
        return {id(family): family.basis(fine) for family in self.families}

    def _report(self, what: str, done: int, total: int) -> None:
        if self.progress is not None:
            self.progress(what, min(1.0, done / total))
