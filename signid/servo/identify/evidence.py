"""Model selection on windows that took no part in a fit: probabilities of laws, and whether a number helps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...parameters import Array

DRAWS = 2000  # Bayesian bootstrap (Rubin, Annals of Statistics 9(1), 1981)
SAME = 1e-3  # log rms; closer scores count as equal
GAIN = 0.01  # log rms that an additional number must save on windows that took no part
SURE = 2.0  # standard errors of that saving
LOUDER = 1.02  # ratio by which the rms over all these windows may grow
FLOOR = 1e-6  # [rad or m] rms below which windows are equally good


def window_scores(error: Array, windows: Sequence[slice]) -> Array:
    """Log rms (W, n) of a simulation error (N, n) [rad or m] over windows of rows; NaN where a window has no rows."""
    rows = [np.sqrt(np.nanmean(error[window] ** 2, axis=0)) for window in windows if len(error[window])]
    return np.asarray(np.log(np.maximum(np.array(rows).reshape(-1, error.shape[1]), FLOOR)))


def law_probabilities(scores: Mapping[str, Array], seed: int = 0) -> dict[str, float]:
    """Probability that each law has the smallest expected score.

    scores: by law, (W,) log rms of the same windows, which took no part in the fit. Equal laws share the probability;
    few windows never give certainty.
    """
    laws = list(scores)
    values = np.array([scores[law] for law in laws], float).reshape(len(laws), -1)
    values = values[:, np.isfinite(values).all(axis=0)]
    if values.shape[1] == 0:
        return {law: 1.0 / len(laws) for law in laws}
    weights = np.random.default_rng(seed).dirichlet(np.ones(values.shape[1]), DRAWS)
    top = np.exp(2 * (values - values.max()))
    means = (weights @ values.T + 0.5 * np.log(weights @ top.T)) / 2  # (DRAWS, laws); typical windows, and loud ones
    best = means <= means.min(axis=1, keepdims=True) + SAME
    share = np.mean(best / best.sum(axis=1, keepdims=True), axis=0)
    count = values.shape[1]
    return {law: float((s * count + 1 / len(laws)) / (count + 1)) for law, s in zip(laws, share, strict=True)}


def improves(before: Array, after: Array) -> bool:
    """Whether a change saves error on windows that took no part: (W,) log rms before and after."""
    saved = np.asarray(before - after, float).ravel()
    saved = saved[np.isfinite(saved)]
    if len(saved) < 2:
        return False
    error = saved.std(ddof=1) / np.sqrt(len(saved))
    loud = np.nanmean(np.exp(2 * after)) <= LOUDER**2 * np.nanmean(np.exp(2 * before))
    return bool(loud and saved.mean() > GAIN and saved.mean() > SURE * error)
