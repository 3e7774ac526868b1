"""Covariance of fitted numbers: sandwich clustered by window, never below the classical one."""

from __future__ import annotations

import numpy as np

from ...types import Array

WEAK = 1e-12  # relative eigenvalue of the information below which a direction is not identifiable


def covariance(information: Array, scores: Array) -> Array:
    """Covariance (P, P) in the units of the values.

    information: (P, P) of white residuals; scores: (W, P) gradient of each window at the optimum, in time order.
    """
    count, windows = len(information), len(scores)
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = _inverse(information / np.outer(size, size)) / np.outer(size, size)
    meat = scores.T @ scores * windows / max(windows - count, 1)
    robust = inverse @ meat @ inverse
    wider = np.sqrt(np.maximum(np.diag(inverse) / np.maximum(np.diag(robust), 1e-300), 1.0))
    return np.asarray(robust * np.outer(wider, wider))


def _inverse(matrix: Array) -> Array:
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors / np.maximum(values, WEAK * values[-1])) @ vectors.T)
