"""Residual -> how many of its samples are worth one that is independent of the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...types import Array

FADED = 0.05  # correlation from which on there is none
PAIRS = 0.1  # of the samples: fewer pairs do not tell a correlation


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
