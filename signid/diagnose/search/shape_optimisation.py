"""Hypotheses on a grid of shapes -> the shapes that explain most."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np

from ...deadline import show_step, time_is_up
from ...effects import EFFECTS
from ...effects.base import RecordingLaw
from ...optimisers import OPTIMISERS, Problem
from ...optimisers.base import Optimum
from ...types import Array, EffectProtocol, Law
from ..data.column_groups import Group
from ..data.dataset import Dataset, append
from ..data.hypotheses import Hypothesis, Key
from ..data.normal_equations import Fitted
from ..evidence.posterior_odds import Posterior
from ..evidence.selection import Selection
from .contributions import measure_sizes
from .stepwise import SEARCH, inflated_dispersion

EVALUATIONS, SAME = 20, 0.02  # for each shape; log odds that do not matter
REACH = 1.6  # by which a shape may be changed, as a factor
FURTHER, AT_THE_END = 4, 0.99  # times that the size of a law of the record may become larger still; share of the reach
ENDS, SAMPLES = ("start", "end"), 6  # of a window; by so many samples each is moved at last
WINDOW = 0.5  # [s] by which the ends of a window may be moved
ALGORITHM = "LN_BOBYQA"
FAR = {"rad": 0.7, "s": 0.3}  # from which on no record is off


def optimise_shapes(dataset: Dataset, found: Selection) -> Selection:
    """The selected laws, each with its best shape; laws of the record are taken at their size, not as small.

    Args:
        dataset: gives the motions.
        found: the selected laws.
    """
    for group in found.selected:
        options = _options(found.posterior, group, {other.claim.key for other in found.selected})
        if not options or time_is_up(SEARCH):
            continue
        show_step(f"fitting numbers of {group.claim.key[0]}", 0.7)
        rest = found.without(group)
        dispersion = inflated_dispersion(rest)
        fit = found.evidence.fit(rest.selected, dispersion, found.prior_scale)
        beside = (rest, fit, dispersion)
        tried = [_polish(dataset, option, beside) for option in options if _fits(option, beside)]
        if not tried:
            continue
        tried.sort(key=lambda t: -t[0])
        data, new = append(dataset, found.data, *tried[0][1:])
        for _, rival, columns in tried[1:]:  # at its size too, so that both are weighed alike
            data, _ = append(dataset, data, rival, columns)
        selected = tuple(new if g is group else g for g in found.selected)
        log = {(new if g is group else g): x for g, x in found.log_odds.items()}
        posterior = replace(found.posterior, evidence=replace(found.evidence, data=data))
        found = replace(found, posterior=posterior, selected=selected, log_odds=log)
    return found


def _options(posterior: Posterior, group: Group, taken: Collection[Key]) -> list[tuple[Hypothesis, Group]]:
    """What may stand in the place of a hypothesis, each with where to begin: itself, and twins in the record.

    Args:
        posterior: odds of every hypothesis.
        group: the hypothesis.
        taken: the selected laws already.
    """
    hypothesis = group.claim
    if len(hypothesis.laws) != 1:
        return []
    law = hypothesis.laws[0]
    twins = [
        (_at_size(EFFECTS[name], law.joints), posterior.evidence.data.groups[posterior.keys[name, law.joints][0]])
        for name in law.effect.twins
        if _is_small(EFFECTS[name]) and (name, law.joints) in posterior.keys and (name, law.joints) not in taken
    ]
    if _is_small(law.effect):
        return [(_at_size(law.effect, law.joints), group), *twins]
    if isinstance(law.effect, RecordingLaw) or not (twins or law.effect.shape(law.parameters)):
        return []
    return [(hypothesis, group), *twins]


def _at_size(effect: EffectProtocol, joints: tuple[int, ...]) -> Hypothesis:
    """A law of the record whose number is still to be found."""
    return Hypothesis((Law(effect, joints, dict.fromkeys(effect.linear(), 0.0)),), finite=True)


def _is_small(effect: EffectProtocol) -> bool:
    """Whether an effect changes the record by one number that may be small."""
    return isinstance(effect, RecordingLaw) and len(effect.linear()) == 1


Beside = tuple[Selection, Fitted, Array]  # the others that are selected, their fit, the dispersion (n,) [1]


def _polish(
    dataset: Dataset, option: tuple[Hypothesis, Group], beside: Beside
) -> tuple[float, Hypothesis, dict[int, Array]]:
    """The best numbers of a law, what they explain, and its columns (M, d) per joint."""
    known, (rest, fit, dispersion) = option[0], beside
    law, start = known.laws[0], _start(option, rest, dispersion)
    keys, moved = list(start), [_reach(key) for key in start]

    def hypothesis(x: Array) -> Hypothesis:
        numbers = {key: move(start[key], float(v)) for key, move, v in zip(keys, moved, x, strict=True)}
        return replace(known, laws=(Law(law.effect, law.joints, {**law.parameters, **numbers}),))

    def cost(x: Array) -> float:
        tried = hypothesis(x).laws[0]
        if not any(tried.effect.possible(p.motion.at(tried.joints), **_shape(tried)) for p in dataset.pieces):
            return 0.0
        told = dataset.columns(hypothesis(x))
        return -(rest.posterior.candidate_log_odds(fit, dispersion, known, told, dataset.whiten(told)) or 0.0)

    zero = np.zeros(len(keys))
    if not keys:
        return -cost(zero), known, dataset.columns(known)
    best = _minimised(cost, zero, FURTHER if known.finite else 0)
    ends = [k for k, key in enumerate(keys) if key in ENDS]
    value, x = _stepped(cost, best.value, best.x, ends, dataset.pieces[0].motion.dt / WINDOW)
    chosen = hypothesis(x)
    return -value, chosen, dataset.columns(chosen)


def _minimised(cost: Callable[[Array], float], start: Array, further: int) -> Optimum:
    """The best steps within reach of some, and of the best of these where it is as large as they reach."""
    budget = EVALUATIONS * len(start)
    while True:
        problem = Problem(cost, start - 1, start + 1, start, search=SEARCH, tolerance=SAME)
        best = OPTIMISERS["nlopt"].minimise(problem, algorithm=ALGORITHM, budget_evaluations=budget)
        if further == 0 or np.all(best.x - start < AT_THE_END) or time_is_up(SEARCH):
            return best
        start, further = best.x, further - 1


def _stepped(
    cost: Callable[[Array], float], value: float, x: Array, ends: list[int], step: float
) -> tuple[float, Array]:
    """Ends of windows moved sample by sample, while that costs less: between samples nothing changes."""
    for k in ends:
        for way in (step, -step):
            for _ in range(SAMPLES):
                moved = x + way * (np.arange(len(x)) == k)
                if (told := cost(moved)) >= value:
                    break
                value, x = told, moved
    return value, x


def _fits(option: tuple[Hypothesis, Group], beside: Beside) -> bool:
    """Whether a law of the record would have a size that a record can have."""
    known, (rest, _, dispersion) = option[0], beside
    if not known.finite:
        return True
    kinds, start = known.laws[0].effect.linear(), _start(option, rest, dispersion)
    return all(
        0 < abs(x) < FAR.get(kinds[key].unit, np.inf) and not (kinds[key].positive and x < 0)
        for key, x in start.items()
    )


def _shape(law: Law) -> dict[str, float]:
    return dict(law.effect.shape(law.parameters))


def _start(option: tuple[Hypothesis, Group], rest: Selection, dispersion: Array) -> dict[str, float]:
    """Numbers to begin with: the shape on its grid, or the size that the small law suggests."""
    (known, group), law = option, option[0].laws[0]
    if not known.finite:
        return dict(law.effect.shape(law.parameters))
    sizes = measure_sizes(rest.evidence, (*rest.selected, group), dispersion, rest.prior_scale)
    (key,) = law.effect.linear()
    return {key: float(sizes.value[group][0])}


def _reach(key: str) -> Callable[[float, float], float]:
    """How a number follows a step from -1 to 1: ends of windows by addition, all else by a factor."""
    if key in ENDS:
        return lambda x, step: x + WINDOW * step
    return lambda x, step: float(x * REACH**step)
