"""Make corrected inertial parameters physically consistent."""

from __future__ import annotations

import numpy as np

from ...estimation.feasible import ConsistentFit, fit_consistent
from ...types import INERTIAL, Array, BaseMap, Estimate, Parameters, pseudo_inertia

PRIOR_WEIGHTS = (0.01, 1.0)  # weights of the stated bodies where torque shows nothing, tried in turn [1]; heuristic
ABSURD_MASS = 5.0  # mass over stated mass plus step beyond which the larger weight is used [1]; heuristic
RELATIVE_STD, ABSOLUTE_STD = 1e-6, 1e-12  # least std of a base parameter, relative and absolute: conditions the inverse


def move_bodies(base: BaseMap, inertials: Array, step: Array, covariance: Array) -> Array:
    """Add a step to the bodies; project onto the physically consistent set where the sum lies outside it.

    Distance is measured in the metric of the covariance. A body that is inconsistent as stated may stay so.

    Args:
        base: base parameters of the rigid bodies.
        inertials: (nb, 10) in Pinocchio's order [kg, kg.m, kg.m2].
        step: (nb, 10) change of each [kg, kg.m, kg.m2].
        covariance: (k, k) covariance of the step, k = 10 nb [products of the units].
    """
    if is_possible(inertials, inertials + step):
        return inertials + step
    bodies = inertials
    for weight in PRIOR_WEIGHTS:
        bodies = nearest_bodies(base, inertials, step, covariance, weight).parameters.bodies()
        if np.all(bodies[:, 0] < ABSURD_MASS * (inertials[:, 0] + np.abs(step[:, 0]))):
            break
    return bodies


def nearest_bodies(
    base: BaseMap, inertials: Array, step: Array, covariance: Array, weight: float = PRIOR_WEIGHTS[0]
) -> ConsistentFit:
    """Project bodies plus a step onto the physically consistent set, in the metric of the covariance.

    Args:
        base: base parameters of the rigid bodies.
        inertials: (nb, 10) in Pinocchio's order [kg, kg.m, kg.m2].
        step: (nb, 10) change of each [kg, kg.m, kg.m2].
        covariance: (k, k) covariance of the step, k = 10 nb [products of the units].
        weight: weight of the stated bodies in directions that torque does not show [1].
    """
    value, spread = base.combination @ (inertials + step).ravel(), base.combination @ covariance @ base.combination.T
    spread = spread + np.diag((RELATIVE_STD * np.abs(value) + ABSOLUTE_STD) ** 2)
    size = np.sqrt(np.diag(spread))
    information = np.linalg.pinv(spread / size / size[:, None], rcond=1e-10, hermitian=True) / size / size[:, None]
    estimate = Estimate(value, spread, information, np.zeros(len(base.sees)), ())
    return fit_consistent(base, estimate, Parameters(base.labels, inertials.ravel()), prior_weight=weight)


def is_possible(stated: Array, inertials: Array) -> bool:
    """Whether all inertials are physically consistent; a body that is inconsistent as stated may stay so.

    Args:
        stated: (nb, 10) inertials of the simulation [kg, kg.m, kg.m2].
        inertials: (nb, 10) [kg, kg.m, kg.m2].
    """
    return bool(np.all(_least(inertials) > np.minimum(0.0, _least(stated))))


def _least(inertials: Array) -> Array:
    """(nb,) smallest eigenvalue of each pseudo-inertia matrix [kg or kg.m2]."""
    return np.array([np.linalg.eigvalsh(pseudo_inertia(body)).min() for body in inertials.reshape(-1, len(INERTIAL))])
