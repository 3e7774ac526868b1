"""Multistart steepest ascent on |B s|^2: good signs in milliseconds, without proof."""

from __future__ import annotations

import numpy as np

from ...types import Array, Indices
from .problem import SignProblem

STARTS = 150  # logs: a single start reaches the optimum in 2 to 60 % of the cases
VECTORS = 3  # leading singular vectors of B, and of B with unit columns, used as starts; heuristic
PAIRED = 12  # best different local optima that are continued with flips of pairs; heuristic
LEAST = 1e-12  # [total energy] smallest gain of a flip; rounding
TURNS = 20  # [flips per segment] at most, since rounding errors could go on for ever; heuristic


def climb(problem: SignProblem, seed: int = 0) -> Array:
    """The best local optimum (S,) [1] of many starts; a known segment has sign +1."""
    ends = np.unique(ascend(problem, _starts(problem, seed)), axis=0)
    losses = np.array([problem.loss(signs) for signs in ends])
    best = np.argsort(losses, kind="stable")[:PAIRED]
    ends[best] = ascend(problem, ends[best], pairs=True)
    losses[best] = [problem.loss(signs) for signs in ends[best]]
    return np.asarray(ends[np.argmin(losses)])


def ascend(problem: SignProblem, starts: Array, joints: bool = True, pairs: bool = False) -> Array:
    """Local optima (K, S) [1] of steepest ascent from starts (K, S) [1], by flips of segments, whole joints and pairs.

    A known segment may be flipped on the way; in the end all signs are inverted where it is -1, which has the same
    loss. Local optima are candidates without proof, so an ascent that is cut short does no harm.
    """
    gram = problem.projections.T @ problem.projections
    signs = np.array(starts, dtype=float)
    pull = signs @ gram
    least = LEAST * float(problem.energies.sum())
    groups = [np.flatnonzero(problem.joints == j) for j in np.unique(problem.joints)]
    active = np.arange(len(signs))
    for _ in range(TURNS * problem.count):
        if not len(active):
            break
        _flip_single(gram, signs, pull, least, active)
        moved = _flip_groups(gram, groups, signs, pull, least, active) if joints else np.zeros(len(active), dtype=bool)
        if pairs:
            moved = np.array(
                [m or _flip_pair(gram, signs[k], pull[k], least) for m, k in zip(moved, active, strict=True)]
            )
        active = active[moved]
    return signs * signs[:, -1:] if problem.anchored else signs


def _starts(problem: SignProblem, seed: int) -> Array:
    """(K, S) signs of leading singular vectors of B, plain and with unit columns; of random models; random signs."""
    rng = np.random.default_rng(seed)
    size = np.linalg.norm(problem.projections, axis=0)
    found = [
        np.linalg.svd(matrix, full_matrices=False)[2][:VECTORS]
        for matrix in (problem.projections, problem.projections / np.maximum(size, 1e-300))
    ]
    left = STARTS - 2 * VECTORS
    models = rng.normal(size=(left - left // 2, len(problem.projections))) @ problem.projections
    return np.where(np.concatenate([*found, models, rng.normal(size=(left // 2, problem.count))]) >= 0, 1.0, -1.0)


def _flip_single(gram: Array, signs: Array, pull: Array, least: float, active: Indices) -> None:
    size = np.diag(gram)
    for _ in range(TURNS * len(size)):
        if not len(active):
            break
        gain = size - signs[active] * pull[active]  # a quarter of the gain of |B s|^2
        at = np.argmax(gain, axis=1)
        good = gain[np.arange(len(active)), at] > least
        active, at = active[good], at[good]
        pull[active] -= 2 * signs[active, at][:, None] * gram[at]
        signs[active, at] *= -1


def _flip_groups(gram: Array, groups: list[Indices], signs: Array, pull: Array, least: float, active: Indices) -> Array:
    """Flip the best group of each start; returns a mask of the starts that gained."""
    gains = np.empty((len(active), len(groups)))
    for k, group in enumerate(groups):
        own = signs[np.ix_(active, group)]
        gains[:, k] = np.sum(own * (own @ gram[np.ix_(group, group)] - pull[np.ix_(active, group)]), axis=1)
    best = np.argmax(gains, axis=1)
    moved = gains[np.arange(len(active)), best] > least
    for start, k in zip(active[moved].tolist(), best[moved].tolist(), strict=True):
        group = groups[k]
        pull[start] -= 2 * signs[start, group] @ gram[group]
        signs[start, group] *= -1
    return np.asarray(moved)


def _flip_pair(gram: Array, signs: Array, pull: Array, least: float) -> bool:
    """Flip the best pair of segments of one start; returns whether it gained."""
    alone = np.diag(gram) - signs * pull
    gain = alone[:, None] + alone + 2 * gram * np.outer(signs, signs)
    np.fill_diagonal(gain, -np.inf)
    at = np.array(np.unravel_index(int(np.argmax(gain)), gain.shape))
    if gain[at[0], at[1]] <= least:
        return False
    pull -= 2 * signs[at] @ gram[at]
    signs[at] *= -1
    return True
