"""A selected law -> how surely it improves the prediction in all parts of the recordings, whatever else is wrong."""

from __future__ import annotations

import numpy as np
from scipy.special import stdtr

from ...types import Array
from ..data.column_groups import Group
from ..evidence.posterior_odds import Posterior
from ..evidence.thresholds import PRIOR_NOTHING
from .contributions import Sizes

BLOCKS, LEAST = 8, 3  # of rows, in each of which a law makes as much torque; and how many are needed to judge
SMALLEST = 1e-15  # least probability that counts


def steadiness(posterior: Posterior, sizes: Sizes, rest: Array, group: Group) -> float:
    """Log odds that a law makes the prediction better, from how much it does so in parts of the recordings [-].

    Its log likelihood ratio against its absence is summed over blocks of rows in each of which it makes as much torque:
    a law that is right gains about the same in each, one that imitates something else gains here and loses there. The
    mean over its standard error is compared with Student's t. Holds for models that are wrong, both of them.

    Args:
        posterior: odds of every hypothesis.
        sizes: of the selected laws.
        rest: (M, n) [N.m or N] what all of them leave.
        group: one of them.

    Source: Vuong, Likelihood ratio tests for model selection and non-nested hypotheses, Econometrica 57, 1989.
    """
    data, gain, energy = posterior.evidence.data, np.zeros(len(rest)), np.zeros(len(rest))
    for j in data.rows(group):
        size = max(float(np.sqrt(np.mean(rest[:, j] ** 2))), 1e-300)
        torque, left = data.raw(j, group) @ sizes.value[group] / size, rest[:, j] / size
        gain, energy = gain + left * torque + torque**2 / 2, energy + torque**2
    made = np.cumsum(energy)
    if not made[-1] > 0:
        return np.inf
    block = np.minimum((BLOCKS * made / made[-1]).astype(int), BLOCKS - 1)
    gains = np.array([gain[block == k].sum() for k in np.unique(block)])
    if len(gains) < LEAST:
        return np.inf
    error = float(np.std(gains, ddof=1)) / np.sqrt(len(gains))
    better = float(stdtr(len(gains) - 1, float(np.mean(gains)) / max(error, 1e-300)))
    prior = posterior.priors.get(group.claim.key, 0.0) - float(np.log(PRIOR_NOTHING))
    return float(np.log(max(better, SMALLEST)) - np.log(max(1 - better, SMALLEST))) + prior
