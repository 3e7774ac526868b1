"""Inertials with a correction -> inertials that a real robot could have."""

from __future__ import annotations

import numpy as np

from ..consistent import fit_consistent
from ..types import INERTIAL, Array, BaseMap, Estimate, Parameters, pseudo_inertia

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
    moved = inertials + step
    if np.all(_least(moved) > np.minimum(0.0, _least(inertials))):
        return moved
    value, spread = base.combination @ moved.ravel(), base.combination @ covariance @ base.combination.T
    spread = spread + np.diag((EXACT * np.abs(value) + TINY) ** 2)
    size = np.sqrt(np.diag(spread))
    information = np.linalg.pinv(spread / size / size[:, None], rcond=1e-10, hermitian=True) / size / size[:, None]
    estimate = Estimate(value, spread, information, np.zeros(len(base.sees)), ())
    prior = Parameters(base.labels, inertials.ravel())
    return fit_consistent(base, estimate, prior).parameters.bodies()


def _least(inertials: Array) -> Array:
    """(nb,) smallest eigenvalue of each pseudo-inertia [kg or kg.m2]."""
    return np.array([np.linalg.eigvalsh(pseudo_inertia(body)).min() for body in inertials.reshape(-1, len(INERTIAL))])
