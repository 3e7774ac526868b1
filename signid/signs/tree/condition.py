"""Classical order of the segments: a small well-conditioned set first, then one segment at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, islice
from math import comb
from typing import NamedTuple

import numpy as np

from ...types import Array, Indices
from ..search.problem import SignProblem

LOST = 1e-14  # [largest eigenvalue of a Gram matrix] smaller eigenvalues are rounding errors
CONDITION = 1000.0  # [1] condition number of a well-conditioned first set; heuristic
LARGEST = 3  # [segments] up to which all sets are tried; heuristic
SETS = 20_000  # [sets] tried at most; heuristic
MOST = 8  # [segments] of a first set chosen one by one, since a tree tries all 2^8 of their signs; heuristic
BLOCK = 256  # [Gram matrices] decomposed at a time; bounds memory
GENERATED = 100  # [sets generated per set tried] at most, since few sets may contain the joints needed; heuristic

_Set = tuple[int, ...]


class SegmentOrder(NamedTuple):
    """Order in which a tree takes the segments."""

    order: Indices  # (S,)
    start: int  # segments of the first set, of which all signs are tried
    condition: float  # condition number of the first set's stacked rows; infinite if they are rank deficient
    complete: bool  # whether all sets of that size and of smaller ones were tried


def condition_order(problem: SignProblem, threshold: float = CONDITION, budget: int = SETS) -> SegmentOrder:
    """Order the segments: the smallest set whose stacked rows are well conditioned, then greedily.

    Each later segment is the one that gives the smallest condition number with all before it, over base parameters in
    their own units. All sets of one, two ... LARGEST segments are tried, `budget` sets at most; if a limit ends that,
    the first set is chosen one segment at a time and `complete` is False. Friction of a joint acts in its own segments
    only, so seven joints need at least seven segments, and 93 segments have 1e10 such sets. A segment of known sign
    comes first.

    Source: the condition number as a measure of excitation: Gautier, Khalil, Int. J. Robotics Research 11(4), 1992.
    """
    left, size, _ = np.linalg.svd(np.linalg.pinv(problem.back), full_matrices=False)
    turn, unknown = left * size, problem.count - problem.anchored
    grams = turn.T @ problem.grams @ turn  # (S, r, r) with the eigenvalues over base parameters in their own units
    known = tuple(range(unknown, problem.count))
    first, complete = _smallest(grams, known, problem.joints[:unknown], threshold, budget)
    if first is None:
        first = _one_by_one(grams, known, unknown, threshold)[: len(known) + MOST]
    lost, condition = _conditioning(grams[list(first)].sum(0)[None])
    order = np.array(_one_by_one(grams, first, unknown), dtype=np.intp)
    return SegmentOrder(order, len(first), np.inf if lost[0] else float(condition[0]), complete)


def _conditioning(grams: Array) -> tuple[Array, Array]:
    """Rank deficiency, and condition number of the rest, of (k, r, r) Gram matrices."""
    values = np.linalg.eigvalsh(grams)
    lost = (values <= LOST * values[:, -1:]).sum(1)
    least = np.take_along_axis(values, np.minimum(lost, values.shape[1] - 1)[:, None], 1)[:, 0]
    return lost, np.sqrt(np.maximum(values[:, -1], 0.0) / np.maximum(least, 1e-300))


def _smallest(grams: Array, known: _Set, joints: Indices, threshold: float, budget: int) -> tuple[_Set | None, bool]:
    """Best set of the smallest size that has a well-conditioned one, and whether all sets up to it were tried."""
    base, needed, own = grams[list(known)].sum(0), _needed(grams, joints), joints.tolist()
    for size in range(0 if known else 1, min(LARGEST, len(joints)) + 1):
        if size < len(needed):
            continue
        if comb(len(joints), size) > GENERATED * budget:
            return None, False
        sets = (s for s in combinations(range(len(joints)), size) if needed <= {own[i] for i in s})
        taken = list(islice(sets, budget + 1))
        if len(taken) > budget:
            return None, False
        budget -= len(taken)
        best = min(_tried(grams, base, taken), default=(0, np.inf, ()))
        if taken and best[0] == 0 and best[1] < threshold:
            return (*known, *best[2]), True
    return None, LARGEST >= len(joints)


def _needed(grams: Array, joints: Indices) -> set[int]:
    """Joints without whose segments the rows are rank deficient."""
    total = grams.sum(0)
    rest = [(j, total - grams[: len(joints)][joints == j].sum(0)) for j in np.unique(joints).tolist()]
    return {j for j, gram in rest if _conditioning(gram[None])[0][0] > 0}


def _tried(grams: Array, base: Array, sets: Sequence[_Set]) -> Iterator[tuple[int, float, _Set]]:
    for k in range(0, len(sets), BLOCK):
        block = sets[k : k + BLOCK]
        lost, condition = _conditioning(base + grams[np.array(block, dtype=np.intp)].sum(1))
        yield from zip(lost.tolist(), condition.tolist(), block, strict=True)


def _one_by_one(grams: Array, first: _Set, unknown: int, threshold: float = 0.0) -> _Set:
    """A set and the segments added to it greedily, until it is well conditioned or complete."""
    taken, total = list(first), grams[list(first)].sum(0)
    left = [i for i in range(unknown) if i not in first]
    while left:
        lost, condition = _conditioning(total[None])
        if lost[0] == 0 and condition[0] < threshold:
            break
        lost, condition = _conditioning(total + grams[left])
        best = left.pop(int(np.lexsort((condition, lost))[0]))
        taken.append(best)
        total = total + grams[best]
    return tuple(taken)
