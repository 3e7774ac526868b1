"""Two laws -> the motion that tells them apart, or the finding that none does."""

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
from .law_distance import Distance, Rivals, beside_laws
from .search import POOL, Duel

INDEPENDENT = 20.0  # [Hz] samples of torque with independent errors, after filters
REMEMBER = 100.0  # [Hz] of the motion where a law has a memory
PERIODS = (1, 2, 4, 12)  # of the base frequency, in turn
STRUCTURAL = 1e-8  # of a law's sum of squares: less is rounding


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
    """The motion along which two laws differ most, whichever is true, while the other and the nuisance are fitted.

    The distance is the sum of squares, over the noise (as in `excite`, 20 independent samples a second), that the
    other law and the nuisance leave of a law's torque. Random Fourier motions of random centre and size are tried,
    the best polished. Parameters that a law does not state take the usual values of its effect while it is taken for
    true; as the other it is fitted, with shapes on their grid unless it states them.

    Args:
        model: robot, inertials and laws as known so far.
        first: a law at its joints.
        second: another.
        nuisance: "friction" (viscous, Coulomb, offset at every joint: inertials are known) or "bodies" as well.
        duration: of the motion [s].
        harmonics: of its series.
        limits: as `build_limits` makes them; those of the description, if None.
        clearance: smallest distance between links [m].
        rate: of the samples of the result [Hz].
        seed: of all random numbers.
        progress: told what is being done and the share of it that is done.

    Raises:
        OptionError: the laws are the same or stand nowhere, an option is unknown, or a limit leaves no motion.

    Source: T-optimality, Atkinson, Fedorov, Biometrika 62(1), 1975.
    """
    _refuse(model, first, second, nuisance)
    check_duration(duration, harmonics, 1 / duration if duration > 0 else 0.0)
    limits = limits or build_limits(model.robot)
    families = [Fourier(duration, harmonics, periods / duration) for periods in PERIODS]
    usual = [effect.name for effect in EFFECTS if effect.usual]
    laws = beside_laws(usual_laws(model, usual), first, second)
    problem, notes = build_problem(model, laws, families[0], limits, clearance, seed)
    density = REMEMBER if any(getattr(law.effect, "memory", False) for law in (first, second)) else INDEPENDENT
    rivals = Rivals(problem, first, second, nuisance == "bodies", INDEPENDENT / density)
    t = at_rate(duration, density)
    duel = Duel(rivals, t, families, seed, progress)
    pool = duel.draw()
    ways = tuple(way for way in (0, 1) if max(tried.distance.shares[way] for tried in pool) > STRUCTURAL)
    ends = duel.polish(pool, ways) if ways else [max(pool, key=lambda tried: float(np.ptp(tried.x[:, 1:])))]
    feasible = [(end.family, make_feasible(problem, end.family, end.x)) for end in ends]
    family, best = max(feasible, key=lambda end: duel.worth(end[0], end[1].x, ways))
    distance = duel.distance(family, best.x)
    ahead = [duel.smaller(tried.distance, ways) for tried in pool]
    evaluated = (len(pool) + sum(end.evaluations for end in ends)) * any(end.spent for end in ends)
    fine = sample(family, model.robot.joints, best.x, grid(duration))
    return Separation(
        trajectory=sample(family, model.robot.joints, best.x, at_rate(duration, rate)),
        laws=(first, second),
        distances=distance.seen,
        shares=distance.shares,
        median=float(np.median(ahead)),
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
            f"no motion of {POOL} can tell {names[0]} from {names[1]}: the difference is structural; "
            "another sensor or a known load is needed",
        )
    if len(ways) == 1:
        hidden = 1 - ways[0]
        return (
            f"{names[1 - hidden]} and what is fitted beside explain whatever {names[hidden]} does, on every motion: "
            f"the laws can be told apart only where {names[1 - hidden]} is true",
        )
    if min(distance.seen) < ENOUGH:
        return (f"the laws differ by {min(distance.seen):.3g} along the best motion; {ENOUGH:g} is needed to be sure",)
    return ()


def _refuse(model: Model, first: Law, second: Law, nuisance: str) -> None:
    for law in (first, second):
        if law.joints not in places(law.effect, len(model.robot.joints)):
            raise OptionError(
                f"{law.effect.name} cannot stand at joints {law.joints} of {model.robot.name}; places of this effect "
                f"are {places(law.effect, len(model.robot.joints))[:8]}, counted from 0"
            )
    if (first.effect.name, first.joints) == (second.effect.name, second.joints):
        raise OptionError(f"both laws are {first.effect.name} at the same joints; give two that differ")
    if nuisance not in ("friction", "bodies"):
        raise OptionError(f"there is no nuisance {nuisance!r}; choose from friction, bodies")
