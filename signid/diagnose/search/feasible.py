"""A hypothesis beside others -> whether it is large enough, possible, and says something new."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...effects.base import ActuatorLaw
from ...regression.projection import leave
from ...types import Array
from ..data.column_groups import Group
from ..evidence.posterior_odds import Posterior
from ..evidence.selection import Selection
from ..extend.bodies import is_possible, nearest_bodies
from ..extend.extend import has_possible_numbers

APPROXIMATE, CLIPPED = (0.3, 2.0), (0.6, 1.5)  # coefficients of laws that are there (1) or not
LEAST = 0.007  # share of some joint's torque that an effect needs
IMPOSSIBLE = 4.0  # squared deviations of each number from the nearest possible bodies: more, and a change is impossible
NARROW = 1e-10  # variance of bodies that do not change [kg2, kg2.m2, kg2.m4]
NEAR = 1.0  # standard deviations by which numbers may differ for the same answer
SPANNED = 1e-3  # of a hypothesis's columns that others leave: it says nothing new


def is_sound(state: Selection, group: Group) -> bool:
    """Whether an effect is large enough, possible, says something new, and is near 1 where it has no number."""
    selected = (*state.selected, group)
    prior_scale = state.evidence.prior_scale(selected, state.dispersion)
    fit, data = state.evidence.fit(selected, state.dispersion, prior_scale), state.data
    prior, value = state.evidence.coefficient_priors[group], fit.value[fit.place(group)]
    assert prior is not None, "hypotheses have beliefs"
    low, high = CLIPPED if isinstance(group.claim.laws[0].effect, ActuatorLaw) else APPROXIMATE
    rms = [np.sqrt(np.mean((data.raw(j, group) @ value) ** 2)) / data.scale[j] for j in data.rows(group)]
    if max(rms) < LEAST or (prior.mean and not low < value[0] < high):
        return False
    if not has_possible_numbers(group, value):
        return False
    if prior.positive >= 0 and value[prior.positive] <= 0:
        at = fit.place(group).start + prior.positive
        if group.size == 1 or value[prior.positive] <= -2 * np.sqrt(fit.covariance[at, at]):
            return False
    return not _is_redundant(state, group) and _has_bodies(
        state.posterior, selected, state.dispersion, prior_scale, group
    )


def _has_bodies(posterior: Posterior, selected: Sequence[Group], base: Array, prior_scale: float, group: Group) -> bool:
    """Whether a change of a body leaves bodies that a real robot could have, within what the rows leave open."""
    law, own = group.claim.laws[0], posterior.bodies
    if own is None or law.effect.name not in ("link_inertia", "payload"):
        return True
    fit = posterior.evidence.fit(selected, base, prior_scale)
    place, body, numbers = fit.place(group), posterior.carried[law.joints[0]], group.claim.numbers
    step = np.zeros_like(own.inertials)
    step[body, : len(numbers)] = numbers @ fit.value[place]
    if is_possible(own.inertials, own.inertials + step):
        return True
    std = np.sqrt(np.diag(fit.covariance)[place])
    asked = posterior.feasibility.setdefault(group, [])
    for value, answer in asked:
        if np.all(np.abs(value - fit.value[place]) <= NEAR * std):
            return answer
    covariance = np.diag(np.full(step.size, NARROW))
    at = 10 * body + np.arange(len(numbers))
    covariance[np.ix_(at, at)] += numbers @ fit.covariance[place, place] @ numbers.T
    near = nearest_bodies(own.base, own.inertials, step, covariance)
    asked.append((fit.value[place], near.feasible_without_moving or near.chi2 < IMPOSSIBLE * group.size))
    return asked[-1][1]


def _is_redundant(state: Selection, group: Group) -> bool:
    """Whether the selected laws can make all that a hypothesis could."""
    data = state.data
    joints = data.rows(group)
    near = [g for g in state.selected if not set(joints).isdisjoint(data.rows(g))]
    if not near:
        return False
    x = np.concatenate([data.part(j, group) for j in joints])
    beside = np.concatenate([np.column_stack([data.part(j, g) for g in near]) for j in joints])
    scale = np.linalg.norm(x, axis=0)
    x = x[:, scale > 0] / scale[scale > 0]
    rest = leave(x, beside)
    return bool(np.sum(rest**2) < SPANNED * np.sum(x**2))
