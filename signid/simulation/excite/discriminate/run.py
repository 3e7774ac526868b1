"""Motion that distinguishes two laws, or the finding that none does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from ....deadline import ends_in_time
from ....effects import EFFECTS
from ....effects.law import places
from ....errors import OptionError
from ....model import Model
from ....types import Law, Progress
from ..design import CLEARANCE
from ..feasible import grid, make_feasible
from ..limits import Limits, build_limits
from ..motions.fourier import Fourier
from ..motions.random_motion import at_rate, check_duration, sample
from ..result import ENOUGH, Separation, budget_notes
from ..setup import build_problem, usual_laws
from .law_distance import INDEPENDENT, STRUCTURAL, Distance, LawPair, nuisance_laws
from .search import POOL, MotionSearch

MEMORY_RATE = 100.0  # [Hz] of the motion if a law has memory
PERIODS = (1, 2, 4, 12)  # base frequencies of the families, in periods per duration


@ends_in_time
def separate(
    model: Model,
    first: Law,
    second: Law,
    *,
    nuisance: Literal["friction", "bodies"] = "friction",
    duration: float = 20.0,
    harmonics: int = 5,
    limits: Limits | None = None,
    clearance: float = CLEARANCE,
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
    _refuse(model, first, second, nuisance)
    check_duration(duration, harmonics, 1 / duration if duration > 0 else 0.0)
    limits = limits or build_limits(model.robot)
    families = [Fourier(duration, harmonics, periods / duration) for periods in PERIODS]
    usual = [effect.name for effect in EFFECTS if effect.usual]
    laws = nuisance_laws(usual_laws(model, usual), first, second)
    problem, notes = build_problem(model, laws, families[0], limits, clearance, seed)
    density = MEMORY_RATE if any(law.effect.memory for law in (first, second)) else INDEPENDENT
    pair = LawPair(problem, first, second, nuisance == "bodies")
    search = MotionSearch(pair, at_rate(duration, density), families, seed, progress)
    pool = search.random_pool()
    ways = tuple(way for way in (0, 1) if max(one.distance.shares[way] for one in pool) > STRUCTURAL)
    ends = search.improve(pool, ways) if ways else [max(pool, key=lambda one: float(np.ptp(one.x[:, 1:])))]
    feasible = [(end.family, make_feasible(problem, end.family, end.x)) for end in ends]
    family, best = max(feasible, key=lambda end: search.objective(end[0], end[1].x, ways))
    distance = search.distance(family, best.x)
    evaluated = (len(pool) + sum(end.evaluations for end in ends)) * any(end.spent for end in ends)
    fine = sample(family, model.robot.joints, best.x, grid(duration))
    return Separation(
        trajectory=sample(family, model.robot.joints, best.x, at_rate(duration, rate)),
        laws=(first, second),
        distances=distance.seen,
        shares=distance.shares,
        median=float(np.median([search.smaller(one.distance, ways) for one in pool])),
        structural=not ways,
        noise=problem.noise,
        use=problem.use(fine),
        distance=best.distance,
        seed=seed,
        notes=(
            *model.robot.notes,
            *limits.notes,
            *notes,
            *budget_notes(evaluated),
        ),
        flags=_flags(first, second, distance, ways),
    )


def _flags(first: Law, second: Law, distance: Distance, ways: Sequence[int]) -> tuple[str, ...]:
    names = first.effect.name, second.effect.name
    if not ways:
        return (
            f"no motion of {POOL} distinguishes {names[0]} from {names[1]}: the difference is structural; "
            "use another sensor or a known load",
        )
    if len(ways) == 1:
        general, special = names[ways[0]], names[1 - ways[0]]
        return (
            f"{general} and the nuisance explain everything that {special} can do, on every motion: the laws are "
            f"distinguishable only if {general} is true",
        )
    if min(distance.seen) < ENOUGH:
        return (
            f"the laws differ by {min(distance.seen):.3g} along the best motion: the result may be ambiguous; "
            f"{ENOUGH:g} is needed",
        )
    return ()


def _refuse(model: Model, first: Law, second: Law, nuisance: str) -> None:
    for law in (first, second):
        if law.joints not in places(law.effect, len(model.robot.joints)):
            raise OptionError(
                f"{law.effect.name} cannot act at joints {law.joints} of {model.robot.name}; choose from "
                f"{places(law.effect, len(model.robot.joints))[:8]}, counted from 0"
            )
    if (first.effect.name, first.joints) == (second.effect.name, second.joints):
        raise OptionError(f"both laws are {first.effect.name} at the same joints; give two that differ")
    if nuisance not in ("friction", "bodies"):
        raise OptionError(f"there is no nuisance {nuisance!r}; choose from friction, bodies")
