"""Signs and their rivals -> how probable each sign is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...types import Array
from ..search.problem import SignProblem

WINDOW = 24.0  # of the loss, in variance units: rivals beyond it weigh less than 1e-5


FADED = 0.05  # correlation from which on there is none

PAIRS = 0.1  # of the samples: fewer pairs do not tell a correlation


def sign_confidence(problem: SignProblem, signs: Array, rival_signs: Array, rival_losses: Array) -> Array:
    """Probability (S,) that each sign is right; the known segment has 1.

    With weights that make the loss a squared number of standard deviations, exp(-J/2) is the posterior of a choice of
    signs under a flat prior on the parameters. A sign's marginal over the rivals is taken, but no more than what
    turning round that segment alone leaves it.

    Args:
        problem: weighted by one over the standard deviation of independent samples.
        signs: (S,) the best [1].
        rival_signs: (K, S) other good ones, and the best itself among them [1].
        rival_losses: (K,) their losses [1].
    """
    weights = np.exp(-(rival_losses - rival_losses.min(initial=np.inf)) / 2)
    same = rival_signs == signs
    marginal = weights @ same / max(float(weights.sum()), 1e-300) if len(weights) else np.ones(problem.count)
    alone = 1 / (1 + np.exp(np.clip(-_flip_costs(problem, signs) / 2, -700, 700)))
    found = np.minimum(marginal, alone)
    return np.where(problem.joints < 0, 1.0, found)


def joint_flip_probability(
    problem: SignProblem, signs: Array, rival_signs: Array, rival_losses: Array
) -> dict[int, float]:
    """Per joint, the probability that all its signs (by far the most of them) are the other way round.

    Args:
        problem: as above.
        signs: (S,) the best [1].
        rival_signs: (K, S) [1].
        rival_losses: (K,) [1].
    """
    weights = np.exp(-(rival_losses - rival_losses.min(initial=np.inf)) / 2)
    total = max(float(weights.sum()), 1e-300)
    doubt = {}
    for joint in np.unique(problem.joints[problem.joints >= 0]).tolist():
        own = problem.joints == joint
        share = np.average(rival_signs[:, own] != signs[own], axis=1, weights=problem.energies[own] + 1e-300)
        doubt[joint] = float(weights[share > 0.5].sum()) / total
    return doubt


def _flip_costs(problem: SignProblem, signs: Array) -> Array:
    """(S,) by how much the loss rises when one segment is turned round."""
    b = problem.projections
    return np.asarray(4 * signs * (b.T @ (b @ signs)) - 4 * np.sum(b**2, axis=0))


def inflation(residual: Array, runs: Sequence[tuple[int, int]]) -> float:
    """Integrated autocorrelation time of one joint's residual, at least 1 sample: 1 + 2 sum of correlations.

    Correlations are those of pairs in one run, of all runs together, up to the first that is small; so it is less than
    twice the length of the longest run. Where the residual is NaN a sample does not count.

    Args:
        residual: (N,) [N.m or N].
        runs: start and stop of stretches of consecutive samples.

    Source: Sokal, Monte Carlo methods in statistical mechanics, in: Functional Integration, 1997, section 3.
    """
    run = np.full(len(residual), -1)
    for k, (start, stop) in enumerate(runs):
        run[start:stop] = k
    inside = (run >= 0) & np.isfinite(residual)
    count, values = int(inside.sum()), np.where(inside, residual, 0.0)
    power = float(values @ values) / max(count, 1)
    longest, total = max((stop - start for start, stop in runs), default=0), 1.0
    for lag in range(1, longest if power > 0 else 0):
        pairs = inside[lag:] & inside[:-lag] & (run[lag:] == run[:-lag])
        if pairs.sum() < PAIRS * count:
            break
        correlation = float(np.mean((values[lag:] * values[:-lag])[pairs])) / power
        if correlation < FADED:
            break
        total += 2 * correlation
    return total
