"""Posterior of the signs of segments: confidence of each, and the inflation of the noise that it needs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...types import Array
from ..search.exact import RivalSigns
from ..search.problem import SignProblem

UNCORRELATED = 0.05  # [1] autocorrelation from which later lags are ignored; tuned on logs and simulations
PAIRS = 0.1  # [share of the samples] smallest number of pairs that estimates a correlation; heuristic


def sign_confidence(problem: SignProblem, signs: Array, rivals: RivalSigns) -> Array:
    """Probability (S,) that each sign is right; 1 for the known segment.

    With a loss in squared standard deviations, p(s) ~ exp(-J_c(s)/2) is the posterior of the signs under a flat prior
    on the parameters, whose normalisation is the same for all s. The confidence of sign i is its marginal over the
    rivals, but at most 1 / (1 + exp(-dJ_i/2)) with dJ_i the rise of J when segment i alone is flipped.

    Args:
        problem: weighted by one over the standard deviation of independent samples.
        signs: (S,) s, the best signs [1].
        rivals: signs near the best.
    """
    weights = rivals.weights
    same = rivals.signs == signs
    marginal = weights @ same / max(float(weights.sum()), 1e-300) if len(weights) else np.ones(problem.count)
    flipped = 1 / (1 + np.exp(np.clip(-_flip_costs(problem, signs) / 2, -700, 700)))
    return np.where(problem.joints < 0, 1.0, np.minimum(marginal, flipped))


def joint_flip_probability(problem: SignProblem, signs: Array, rivals: RivalSigns) -> dict[int, float]:
    """Per joint, the probability that its signs are inverted in segments that hold more than half of its energy.

    Args:
        problem: as in `sign_confidence`.
        signs: (S,) s, the best signs [1].
        rivals: signs near the best.
    """
    weights = rivals.weights
    total = max(float(weights.sum()), 1e-300)
    found = {}
    for joint in np.unique(problem.joints[problem.joints >= 0]).tolist():
        own = problem.joints == joint
        share = np.average(rivals.signs[:, own] != signs[own], axis=1, weights=problem.energies[own] + 1e-300)
        found[joint] = float(weights[share > 0.5].sum()) / total
    return found


def _flip_costs(problem: SignProblem, signs: Array) -> Array:
    """(S,) dJ_i = 4 s_i b_i'B s - 4 |b_i|^2 [squared standard deviations]."""
    b = problem.projections
    return np.asarray(4 * signs * (b.T @ (b @ signs)) - 4 * np.sum(b**2, axis=0))


def inflation(residual: Array, runs: Sequence[tuple[int, int]]) -> float:
    """Integrated autocorrelation time kappa of the residual of one joint: 1 + 2 sum of correlations, at least 1 [1].

    Correlations are pooled over pairs of samples within one run, and summed up to the first small one; so kappa is
    less than twice the length of the longest run. NaN in the residual: the sample is ignored.

    Args:
        residual: (N,) [N.m or N].
        runs: start and stop of runs of consecutive samples.

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
        if correlation < UNCORRELATED:
            break
        total += 2 * correlation
    return total
