"""Optimality criteria of an information matrix."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...types import Array

FLOOR = 1e-13  # [1] smallest eigenvalue over the largest; smaller ones are zero up to rounding
SHARP = 4  # power of the power means that smooth the extreme eigenvalues

Criterion = Callable[[Array], tuple[float, Array]]
"""Information (b, b) [1] -> cost to minimise, and its gradient (b, b)."""


def determinant(information: Array) -> tuple[float, Array]:
    """D-optimality: mean log of the principal standard deviations, and its gradient (b, b) [1].

    Args:
        information: (b, b) [1] of scaled parameters.

    Source: Swevers et al., IEEE T-RA 13(5), 1997, section III.
    """
    values, vectors = _spectrum(information)
    return float(-np.mean(np.log(values)) / 2), -(vectors / values) @ vectors.T / (2 * len(values))


def condition(information: Array) -> tuple[float, Array]:
    """Log of the regressor's condition number, with smoothed extremes, and its gradient (b, b) [1].

    Args:
        information: (b, b) [1] of scaled parameters.

    Source: Gautier, Khalil, Int. J. Robotics Research 11(4), 1992; smoothed by power means of the eigenvalues.
    """
    values, vectors = _spectrum(information)
    large, small = (values / values[-1]) ** SHARP, (values[0] / values) ** SHARP
    top, low = large.sum(), small.sum()
    cost = (np.log(values[-1] / values[0]) + np.log(top * low) / SHARP) / 2
    slope = (large / top - small / low) / values / 2
    return float(cost), (vectors * slope) @ vectors.T


CRITERIA: dict[str, Criterion] = {"determinant": determinant, "condition": condition}


def _spectrum(information: Array) -> tuple[Array, Array]:
    values, vectors = np.linalg.eigh(information)
    return np.maximum(values, FLOOR * max(values[-1], 1e-300)), vectors
