"""The classical tree with least squares at every node: the fast form of it, which the exact search is raced against."""

from __future__ import annotations

import numpy as np

from signid.errors import OptionError
from signid.signs.search.problem import SignProblem
from signid.signs.tree.beam import LOST, WIDTH, TreeLevel, TreeNode, TreeResult, grow, in_place
from signid.types import Indices

from .truth import Array

SOLVERS = ("pseudo-inverse", "factor")


def beam(
    problem: SignProblem, order: Indices, start: int, width: int = WIDTH, solve: str = "pseudo-inverse"
) -> TreeResult:
    """The tree with linear least squares at every node. A sign that is free to be either is left to chance.

    Args:
        problem: the segments.
        order: (S,) in which the tree takes them.
        start: segments whose signs are all tried, before any node is dropped.
        width: nodes kept of each level.
        solve: "pseudo-inverse" of the Gram matrix, anew for every node; "factor": once a level, with the same result.

    Raises:
        OptionError: there is no such way to solve, or the width is not positive.
    """
    if solve not in SOLVERS:
        raise OptionError(f"nodes cannot be solved by {solve!r}; choose from {', '.join(SOLVERS)}")
    node, nodes = grow(problem, order, start, width, _by_pseudo_inverse if solve == SOLVERS[0] else _by_factor)
    signs = in_place(node.signs, order)
    return TreeResult(signs, problem.value(signs), node.loss, nodes, nodes)


def _by_pseudo_inverse(level: TreeLevel, right: Array) -> TreeNode:
    z = np.linalg.pinv(level.gram, rcond=LOST, hermitian=True) @ right
    return TreeNode(max(level.energy - float(right @ z), 0.0), z, 1)


def _by_factor(level: TreeLevel, right: Array) -> TreeNode:
    told = level.turn @ right
    return TreeNode(max(level.energy - float(told @ told), 0.0), told, 1)
