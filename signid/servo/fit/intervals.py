"""Covariance of fitted numbers: sandwich clustered by window, never below the classical one."""

from __future__ import annotations

import numpy as np

from ...types import Array

NOTHING = 1e-9  # influence over the largest one, below which a number is not identifiable
WEAK = 1e-12  # relative eigenvalue of the information below which a direction is not identifiable


def covariance(information: Array, scores: Array) -> Array:
    """Covariance (P, P) in the units of the values; infinite variance without influence.

    information: (P, P) of white residuals; scores: (W, P) gradient of each window at the optimum, in time order.
    """
    size = np.sqrt(np.diag(information))
    seen = size > NOTHING * size.max(initial=0.0)
    out = np.diag(np.where(seen, 0.0, np.inf))
    count, windows = int(seen.sum()), len(scores)
    if not count:
        return out
    scale, scores = np.outer(size[seen], size[seen]), scores[:, seen]
    inverse = _inverse(information[np.ix_(seen, seen)] / scale) / scale
    meat = scores.T @ scores * windows / max(windows - count, 1)
    robust = inverse @ meat @ inverse
    wider = np.sqrt(np.maximum(np.diag(inverse) / np.maximum(np.diag(robust), 1e-300), 1.0))
    out[np.ix_(seen, seen)] = robust * np.outer(wider, wider)
    return out


def _inverse(matrix: Array) -> Array:
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors / np.maximum(values, WEAK * values[-1])) @ vectors.T)
