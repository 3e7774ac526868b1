"""Admissible hypotheses: large enough, physically possible, not redundant; links beyond their tolerance."""

from __future__ import annotations

import numpy as np

from ...effects.base import ActuatorLaw
from ...regression.projection import leave
from ...types import INERTIAL
from ..data.column_groups import Group
from ..data.whitened_rows import Fitted, columns_of
from ..evidence.prior import CoefficientPrior
from ..evidence.selection import Posterior, Selection
from ..extend.extend import has_possible_numbers, is_possible, nearest_bodies
from .thresholds import (
    ACTUATOR_RANGE,
    INERTIAL_VIOLATION,
    INFEASIBLE_CHI2,
    LEAST_TORQUE_SHARE,
    ON_OFF_RANGE,
    REDUNDANT_SHARE,
)

UNCHANGED_VARIANCE = 1e-10  # variance of bodies that do not change [kg2, kg2.m2, kg2.m4]: keeps the covariance regular
SAME_ANSWER = 1.0  # numbers that differ by less get the answer computed before [standard deviations]


def inertial_violations(selection: Selection) -> dict[int, float]:
    """Squared corrections of links beyond any tolerance, by the joint that moves the link [variances].

    Inertials are refitted at the largest prior scale. Empty where they are probably right, or where the model carries
    a covariance.
    """
    if selection.evidence.informed or selection.evidence.prior_scale(selection.selected, selection.dispersion) == 0:
        return {}
    largest = selection.evidence.scales[-1]
    fit = selection.evidence.fit(selection.selected, selection.dispersion, largest)
    bodies = [group for group in selection.data.refitted if group.bodies]
    step = fit.value[np.isin(fit.which, columns_of(bodies))]
    deviation = np.concatenate([group.deviation for group in bodies])
    chi2 = np.sum((step / largest / deviation).reshape(-1, len(INERTIAL)) ** 2, axis=1)
    carried = selection.posterior.carried
    return {j: float(chi2[body]) for j, body in enumerate(carried) if chi2[body] > INERTIAL_VIOLATION}


def resolved_violations(selection: Selection, rest: Selection, group: Group) -> set[int]:
    """Joints whose links violate the tolerance without a body hypothesis (`rest`) and not with it (`selection`)."""
    violated = inertial_violations(rest).keys() if group.claim.bodies else set()
    return violated - inertial_violations(selection).keys() if violated else set()


def is_admissible(selection: Selection, group: Group) -> bool:
    """Whether a hypothesis may be selected beside others.

    Its torque is large enough, its numbers are physically possible, a coefficient without a number is near 1, and the
    selected laws cannot make the same torque.
    """
    selected = (*selection.selected, group)
    evidence, dispersion = selection.evidence, selection.dispersion
    fit = evidence.fit(selected, dispersion, evidence.prior_scale(selected, dispersion))
    prior = evidence.coefficient_priors[group]
    assert prior is not None, "hypotheses have priors"
    value = fit.value[fit.place(group)]
    data = selection.data
    rms = [np.sqrt(np.mean((data.raw(j, group) @ value) ** 2)) / data.scale[j] for j in data.rows(group)]
    if max(rms) < LEAST_TORQUE_SHARE or (prior.mean and not _is_on(group, float(value[0]))):
        return False
    if not has_possible_numbers(group, value) or not _has_right_sign(group, prior, fit):
        return False
    return not _is_redundant(selection, group) and _has_bodies(selection.posterior, group, fit)


def _is_on(group: Group, value: float) -> bool:
    """Whether the coefficient of a law without numbers is near 1."""
    low, high = ACTUATOR_RANGE if isinstance(group.claim.laws[0].effect, ActuatorLaw) else ON_OFF_RANGE
    return low < value < high


def _has_right_sign(group: Group, prior: CoefficientPrior, fit: Fitted) -> bool:
    """Whether a coefficient that physics requires to be positive is so, or is not clearly negative beside others."""
    if prior.positive < 0:
        return True
    at = fit.place(group).start + prior.positive
    value = fit.value[at]
    return not (value <= 0 and (group.size == 1 or value <= -2 * np.sqrt(fit.covariance[at, at])))


def _has_bodies(posterior: Posterior, group: Group, fit: Fitted) -> bool:
    """Whether a change of a body gives physically consistent bodies, within its covariance."""
    law, own = group.claim.laws[0], posterior.bodies
    if own is None or law.effect.name not in ("link_inertia", "payload"):
        return True
    place, body, numbers = fit.place(group), posterior.carried[law.joints[0]], group.claim.numbers
    step = np.zeros_like(own.inertials)
    step[body, : len(numbers)] = numbers @ fit.value[place]
    if is_possible(own.inertials, own.inertials + step):
        return True
    std = np.sqrt(np.diag(fit.covariance)[place])
    asked = posterior.feasibility.setdefault(group, [])
    for value, answer in asked:
        if np.all(np.abs(value - fit.value[place]) <= SAME_ANSWER * std):
            return answer
    covariance = np.diag(np.full(step.size, UNCHANGED_VARIANCE))
    at = 10 * body + np.arange(len(numbers))
    covariance[np.ix_(at, at)] += numbers @ fit.covariance[place, place] @ numbers.T
    near = nearest_bodies(own.base, own.inertials, step, covariance)
    asked.append((fit.value[place], near.feasible_without_moving or near.chi2 < INFEASIBLE_CHI2 * group.size))
    return asked[-1][1]


def _is_redundant(selection: Selection, group: Group) -> bool:
    """Whether the selected laws can make all the torque that a hypothesis can make."""
    data = selection.data
    joints = data.rows(group)
    near = [g for g in selection.selected if not set(joints).isdisjoint(data.rows(g))]
    if not near:
        return False
    x = np.concatenate([data.part(j, group) for j in joints])
    beside = np.concatenate([np.column_stack([data.part(j, g) for g in near]) for j in joints])
    scale = np.linalg.norm(x, axis=0)
    x = x[:, scale > 0] / scale[scale > 0]
    residual = leave(x, beside)
    return bool(np.sum(residual**2) < REDUNDANT_SHARE * np.sum(x**2))
