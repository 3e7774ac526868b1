"""Inertials with a correction -> inertials that a real robot could have."""

from __future__ import annotations

import numpy as np

from ...estimation.feasible import ConsistentFit, fit_consistent
from ...types import INERTIAL, Array, BaseMap, Estimate, Parameters, pseudo_inertia

HELD = (0.01, 1.0)  # how firmly bodies stay as stated where torque tells nothing, if need be [squared deviations]
ABSURD = 5.0  # times as heavy as stated, from which on bodies are held firmly
EXACT, TINY = 1e-6, 1e-12  # share of a base parameter, and size, to which it is never known: spreads are inverted


def move_bodies(base: BaseMap, inertials: Array, step: Array, covariance: Array) -> Array:
    """The bodies moved by a step; where that is impossible, the nearest that real bodies could have.

    Near is measured as the recordings measure it. A body that is impossible already may stay so.

    Args:
        base: which combinations of inertial parameters torque shows.
        inertials: (nb, 10) in Pinocchio's order [kg, kg.m, kg.m2].
        step: (nb, 10) of each [kg, kg.m, kg.m2].
        covariance: (k, k) of the k = 10 nb numbers of the step [products of their units].
    """
    if is_possible(inertials, inertials + step):
        return inertials + step
    bodies = inertials
    for held in HELD:
        bodies = nearest_bodies(base, inertials, step, covariance, held).parameters.bodies()
        if np.all(bodies[:, 0] < ABSURD * (inertials[:, 0] + np.abs(step[:, 0]))):
            break
    return bodies


def nearest_bodies(
    base: BaseMap, inertials: Array, step: Array, covariance: Array, held: float = HELD[0]
) -> ConsistentFit:
    """The feasible bodies nearest to some that are not, as the recordings measure distance.

    Args:
        base: which combinations of inertial parameters torque shows.
        inertials: (nb, 10) in Pinocchio's order [kg, kg.m, kg.m2].
        step: (nb, 10) of each [kg, kg.m, kg.m2].
        covariance: (k, k) of the k = 10 nb numbers of the step [products of their units].
        held: how firmly bodies stay what they were where torque tells nothing [squared standard deviations].
    """
    value, spread = base.combination @ (inertials + step).ravel(), base.combination @ covariance @ base.combination.T
    spread = spread + np.diag((EXACT * np.abs(value) + TINY) ** 2)
    size = np.sqrt(np.diag(spread))
    information = np.linalg.pinv(spread / size / size[:, None], rcond=1e-10, hermitian=True) / size / size[:, None]
    estimate = Estimate(value, spread, information, np.zeros(len(base.sees)), ())
    return fit_consistent(base, estimate, Parameters(base.labels, inertials.ravel()), prior_weight=held)


def is_possible(stated: Array, inertials: Array) -> bool:
    """Whether real bodies could have these inertials; one that was impossible already may stay so.

    Args:
        stated: (nb, 10) as the simulation states them [kg, kg.m, kg.m2].
        inertials: (nb, 10) [kg, kg.m, kg.m2].
    """
    return bool(np.all(_least(inertials) > np.minimum(0.0, _least(stated))))


def _least(inertials: Array) -> Array:
    """(nb,) smallest eigenvalue of each pseudo-inertia [kg or kg.m2]."""
    return np.array([np.linalg.eigvalsh(pseudo_inertia(body)).min() for body in inertials.reshape(-1, len(INERTIAL))])
