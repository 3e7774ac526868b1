"""Beam search over signs: a tree of sign choices that keeps the best few nodes of each level."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from ...errors import OptionError
from ...types import Array, Frozen, Indices, Progress
from ..search.problem import SignProblem

WIDTH = 5  # [nodes per level] kept, as in the classical method
LOST = 1e-13  # [largest eigenvalue of a Gram matrix] smaller eigenvalues are rounding errors


@dataclass(frozen=True, eq=False)
class TreeResult(Frozen):
    """Best node of the last level of a tree."""

    signs: Array  # (S,) s [1]
    value: Array  # (b,) base parameters [units of base]
    loss: float  # [squared standard deviations]
    nodes: int  # solved
    evaluations: int  # of the loss, or least-squares solutions, over all nodes
    notes: tuple[str, ...] = ()


class TreeLevel(NamedTuple):
    """The first k segments of an order, whose signs the nodes of a level choose.

    With right = sum_i s_i b_i, their loss at z is |root z - turn right|^2 + energy - |turn right|^2. It equals the loss
    over their stacked rows, as root'root is the Gram matrix of these.
    """

    gram: Array  # (r, r) sum of A_i [1]
    root: Array  # (m, r) [1] root' root = gram
    turn: Array  # (m, r) [1] pseudo-inverse of root'
    energy: float  # sum of T_i [squared standard deviations]


class TreeNode(NamedTuple):
    """Signs of the segments of a level, and their solution."""

    loss: float  # [squared standard deviations]
    end: Array  # (d,) [any] unknowns of the solver
    evaluations: int
    signs: tuple[float, ...] = ()  # (k,) in the order of the segments


Solve = Callable[[TreeLevel, Array], TreeNode]  # level, right side (r,) [standard deviations]


def grow(
    problem: SignProblem, order: Indices, start: int, width: int, solve: Solve, progress: Progress | None = None
) -> tuple[TreeNode, int]:
    """Grow a tree; returns the best node of the last level with the evaluations of all, and the number of nodes.

    Args:
        problem: boolean least squares.
        order: (S,) order of the segments.
        start: number of segments of which all signs are tried before nodes are dropped.
        width: nodes kept per level.
        solve: solver of a node.
        progress: called with the share of levels done.

    Raises:
        OptionError: the width is not positive.
    """
    if width < 1:
        raise OptionError(f"a tree cannot keep {width} nodes a level; keep at least 1")
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
    """Signs (S,) by segment [1], from signs in the order of a tree.

    Args:
        signs: S signs.
        order: (S,) segment of each sign.
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
