"""Order of the segments by the classical rule: a small well-conditioned set first, then one segment at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, islice
from math import comb
from typing import NamedTuple

import numpy as np

from ...types import Array, Indices
from ..search.problem import SignProblem

LOST = 1e-14  # of the largest eigenvalue of a Gram matrix: rounding
MOST = 8  # segments of a set that is taken one by one: a tree tries all their signs
_BLOCK = 256  # Gram matrices at a time
_LOOKED = 100  # sets looked at for one that may be tried: few may have the joints that are needed

_Set = tuple[int, ...]


class SegmentOrder(NamedTuple):
    """Segments in the order in which a tree takes them."""

    order: Indices  # (S,)
    start: int  # segments of the first set, whose signs are all tried
    condition: float  # of the first set's stacked regressor; infinite where it does not see every direction
    complete: bool  # every smaller set was tried, and so was every other one of that size


def condition_order(
    problem: SignProblem, threshold: float = 1000.0, largest: int = 3, budget: int = 20_000
) -> SegmentOrder:
    """The smallest set of segments whose stacked regressor is well conditioned, then the others.

    Of the others, each time the one with which all so far have the smallest condition number, which is that of the
    base parameters in their own units. All sets of one, two ... segments are tried; where these bounds end that, a set
    is put together one segment at a time, and `complete` is False. Friction of a joint shows in its own segments
    alone: seven joints need seven segments or more, and of 93 there are 1e10 such sets. A segment whose sign is known
    comes first.

    Args:
        problem: the segments.
        threshold: condition number that is small enough.
        largest: segments of the sets that are all tried.
        budget: sets that are tried at most.

    Source: the condition number as a measure of excitation: Gautier, Khalil, Int. J. Robotics Research 11(4), 1992.
    """
    grams, unknown = _in_base(problem), problem.count - problem.anchored
    known = tuple(range(unknown, problem.count))
    first, complete = _smallest(grams, known, problem.joints[:unknown], threshold, largest, budget)
    if first is None:
        first = _one_by_one(grams, known, unknown, threshold)[: len(known) + MOST]
    lost, condition = _judge(grams[list(first)].sum(0)[None])
    order = np.array(_one_by_one(grams, first, unknown), dtype=np.intp)
    return SegmentOrder(order, len(first), np.inf if lost[0] else float(condition[0]), complete)


def _in_base(problem: SignProblem) -> Array:
    """(S, r, r) Gram matrices with the eigenvalues that they have over the base parameters themselves."""
    left, size, _ = np.linalg.svd(np.linalg.pinv(problem.back), full_matrices=False)
    turn = left * size
    return np.asarray(turn.T @ problem.grams @ turn)


def _judge(grams: Array) -> tuple[Array, Array]:
    """Directions that are not seen at all and the condition number over the others, of (k, r, r) Gram matrices."""
    values = np.linalg.eigvalsh(grams)
    lost = (values <= LOST * values[:, -1:]).sum(1)
    least = np.take_along_axis(values, np.minimum(lost, values.shape[1] - 1)[:, None], 1)[:, 0]
    return lost, np.sqrt(np.maximum(values[:, -1], 0.0) / np.maximum(least, 1e-300))


def _smallest(
    grams: Array, known: _Set, joints: Indices, threshold: float, largest: int, budget: int
) -> tuple[_Set | None, bool]:
    """The best set of the smallest size at which one is well conditioned, and whether all were tried up to there."""
    base, needed, own = grams[list(known)].sum(0), _needed(grams, joints), joints.tolist()
    for size in range(0 if known else 1, min(largest, len(joints)) + 1):
        if size < len(needed):
            continue
        if comb(len(joints), size) > _LOOKED * budget:
            return None, False
        sets = (s for s in combinations(range(len(joints)), size) if needed <= {own[i] for i in s})
        taken = list(islice(sets, budget + 1))
        if len(taken) > budget:
            return None, False
        budget -= len(taken)
        best = min(_tried(grams, base, taken), default=(0, np.inf, ()))
        if taken and best[0] == 0 and best[1] < threshold:
            return (*known, *best[2]), True
    return None, largest >= len(joints)


def _needed(grams: Array, joints: Indices) -> set[int]:
    """Joints without whose segments some direction is not seen."""
    total = grams.sum(0)
    rest = [(j, total - grams[: len(joints)][joints == j].sum(0)) for j in np.unique(joints).tolist()]
    return {j for j, gram in rest if _judge(gram[None])[0][0] > 0}


def _tried(grams: Array, base: Array, sets: Sequence[_Set]) -> Iterator[tuple[int, float, _Set]]:
    for k in range(0, len(sets), _BLOCK):
        block = sets[k : k + _BLOCK]
        lost, condition = _judge(base + grams[np.array(block, dtype=np.intp)].sum(1))
        yield from zip(lost.tolist(), condition.tolist(), block, strict=True)


def _one_by_one(grams: Array, first: _Set, unknown: int, threshold: float = 0.0) -> _Set:
    """The set and what is added to it, until it is well conditioned or nothing is left."""
    taken, total = list(first), grams[list(first)].sum(0)
    left = [i for i in range(unknown) if i not in first]
    while left:
        lost, condition = _judge(total[None])
        if lost[0] == 0 and condition[0] < threshold:
            break
        lost, condition = _judge(total + grams[left])
        best = left.pop(int(np.lexsort((condition, lost))[0]))
        taken.append(best)
        total = total + grams[best]
    return tuple(taken)
