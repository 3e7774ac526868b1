"""A tree of sign choices of which the best few nodes of each level are kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from ...errors import OptionError
from ...types import Array, Frozen, Indices, Progress
from ..search.problem import SignProblem

WIDTH = 5  # nodes kept of each level
LOST = 1e-13  # of the largest eigenvalue of a Gram matrix: rounding


@dataclass(frozen=True, eq=False)
class TreeResult(Frozen):
    """Where a tree of sign choices ended."""

    signs: Array  # (S,) [1]
    value: Array  # (b,) base parameters of the winner [units of base]
    loss: float  # of the winner [squared standard deviations]
    nodes: int  # that were solved
    evaluations: int  # over all nodes: of the loss, or least-squares solutions
    notes: tuple[str, ...] = ()


class TreeLevel(NamedTuple):
    """The first k segments of an order, whose signs the nodes of a level choose.

    With right = the sum of their s_i B_i, their loss at z is |root z - turn right|^2 + energy - |turn right|^2: the
    same number as over their stacked rows, of which root is a factor.
    """

    gram: Array  # (r, r) [1]
    root: Array  # (m, r) [1] root' root = gram
    turn: Array  # (m, r) [1] pseudo-inverse of root'
    energy: float  # [squared standard deviations]


class TreeNode(NamedTuple):
    """A choice of signs for the segments of a level, and what solving it gave."""

    loss: float  # [squared standard deviations]
    end: Array  # (d,) [any] the unknowns of the solver
    evaluations: int
    signs: tuple[float, ...] = ()  # (k,) in the order of the segments


Solve = Callable[[TreeLevel, Array], TreeNode]  # level, right side (r,) [standard deviations]


def grow(
    problem: SignProblem, order: Indices, start: int, width: int, solve: Solve, progress: Progress | None = None
) -> tuple[TreeNode, int]:
    """The best node of the last level, with the evaluations of all, and how many nodes were solved.

    Args:
        problem: the segments.
        order: (S,) in which the tree takes them.
        start: segments whose signs are all tried, before any node is dropped.
        width: nodes kept of each level.
        solve: a node.
        progress: told how far it is.

    Raises:
        OptionError: the width is not positive.
    """
    if width < 1:
        raise OptionError(f"a tree of {width} nodes a level was asked for; keep at least 1")
    choices = [(1.0,) if problem.joints[i] < 0 else (1.0, -1.0) for i in order]
    pool, nodes, spent = [TreeNode(0.0, np.zeros(0), 0)], 0, 0
    for k in range(max(start, 1), len(order) + 1):
        level, members = _level(problem, order[:k]), problem.projections[:, order[:k]]
        tried = [(*node.signs, *more) for node in pool for more in product(*choices[len(node.signs) : k])]
        found = [solve(level, members @ np.array(signs))._replace(signs=signs) for signs in tried]
        nodes, spent = nodes + len(found), spent + sum(node.evaluations for node in found)
        pool = sorted(found, key=lambda node: node.loss)[:width]
        if progress is not None:
            progress("growing the tree of signs", k / len(order))
    return pool[0]._replace(evaluations=spent), nodes


def in_place(signs: Sequence[float], order: Indices) -> Array:
    """(S,) [1] signs by segment, of signs in the order of a tree.

    Args:
        signs: S of them.
        order: (S,) the segment that each belongs to.
    """
    out = np.empty(len(order))
    out[order] = signs
    return out


def _level(problem: SignProblem, members: Indices) -> TreeLevel:
    gram = problem.grams[members].sum(0)
    values, axes = np.linalg.eigh(gram)
    seen = values > LOST * values[-1]
    size, axes = np.sqrt(values[seen])[:, None], axes[:, seen].T
    return TreeLevel(gram, size * axes, axes / size, float(problem.energies[members].sum()))
