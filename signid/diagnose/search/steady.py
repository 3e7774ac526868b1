"""Vuong test of a selected law: whether its gain is steady over the recordings."""

from __future__ import annotations

import numpy as np
from scipy.special import stdtr

from ...types import Array
from ..data.column_groups import Group
from ..evidence.posterior_odds import Posterior
from ..evidence.thresholds import PRIOR_NOTHING
from .contributions import Contributions
from .thresholds import BLOCKS, LEAST_BLOCKS, LEAST_PROBABILITY


def steadiness(posterior: Posterior, contributions: Contributions, residual: Array, group: Group) -> float:
    """Log odds that a law improves the prediction, from its gain in blocks of rows [-].

    The log likelihood ratio against its absence is summed over blocks in each of which the law makes the same torque
    energy. The mean over its standard error is compared with Student's t. A law that is right gains about the same in
    each block; a law that imitates something else gains in some and loses in others. The test needs neither model to
    be right.

    Args:
        posterior: odds of every hypothesis.
        contributions: torque of the selected laws.
        residual: (M, n) [N.m or N] residual with all selected laws.
        group: columns of one selected law.

    Source: Vuong, Likelihood ratio tests for model selection and non-nested hypotheses, Econometrica 57, 1989.
    """
    data, gain, energy = posterior.evidence.data, np.zeros(len(residual)), np.zeros(len(residual))
    for j in data.rows(group):
        size = max(float(np.sqrt(np.mean(residual[:, j] ** 2))), 1e-300)
        torque, left = data.raw(j, group) @ contributions.coefficients[group] / size, residual[:, j] / size
        gain, energy = gain + left * torque + torque**2 / 2, energy + torque**2
    made = np.cumsum(energy)
    if not made[-1] > 0:
        return np.inf
    block = np.minimum((BLOCKS * made / made[-1]).astype(int), BLOCKS - 1)
    gains = np.array([gain[block == k].sum() for k in np.unique(block)])
    if len(gains) < LEAST_BLOCKS:
        return np.inf
    error = float(np.std(gains, ddof=1)) / np.sqrt(len(gains))
    better = float(stdtr(len(gains) - 1, float(np.mean(gains)) / max(error, 1e-300)))
    prior = posterior.priors.get(group.claim.key, 0.0) - float(np.log(PRIOR_NOTHING))
    return float(np.log(max(better, LEAST_PROBABILITY)) - np.log(max(1 - better, LEAST_PROBABILITY))) + prior
