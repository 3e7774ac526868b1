"""Least squares with coefficients that are not negative, for the few columns of a joint."""

from __future__ import annotations

import numpy as np

from ..types import Array, Mask

ROUNDING = 1e-12  # share of the largest number beside it that rounding may make


def nonnegative(matrix: Array, target: Array) -> Array:
    """(k,) the coefficients that bring the columns nearest to the target, none of them negative.

    Args:
        matrix: (m, k) [unit of the target per unit of the coefficient] columns.
        target: (m,) [any unit].

    Source: Lawson, Hanson, Solving Least Squares Problems, 1974, chapter 23.
    """
    gram, right = matrix.T @ matrix, matrix.T @ target
    gram.ravel()[:: len(right) + 1] += ROUNDING * gram.max(initial=0.0)  # columns may be the same
    x, free = np.zeros(len(right)), np.zeros(len(right), dtype=bool)
    least = ROUNDING * float(np.abs(right).max(initial=0.0))
    for _ in range(3 * len(right)):
        slope = np.where(free, -np.inf, right - gram @ x)
        if free.all() or slope.max() <= least:
            break
        free[int(np.argmax(slope))] = True
        x, free = _feasible(gram, right, x, free)
    return x


def _feasible(gram: Array, right: Array, x: Array, free: Mask) -> tuple[Array, Mask]:
    """The solution over free coefficients, which are held at zero one after another where it would be negative."""
    while free.any():
        new = np.zeros(len(x))
        new[free] = np.linalg.solve(gram[free][:, free], right[free])
        if np.all(new[free] > 0):
            return new, free
        falls = np.asarray(free & (new <= 0))
        step = float(np.min(x[falls] / np.maximum(x[falls] - new[falls], 1e-300)))
        x = x + step * (new - x)
        free = np.asarray(free & (x > ROUNDING * np.abs(x).max(initial=0.0)))
        x = np.where(free, x, 0.0)
    return np.zeros(len(x)), free
