"""The classical tree of sign choices with linear least squares at every node, as a reference."""

from __future__ import annotations

import numpy as np

from signid.errors import OptionError
from signid.signs.problem import SignProblem
from signid.signs.tree import LEVEL_ROUNDING, TREE_WIDTH, TreeLevel, TreeNode, TreeResult, grow, in_place
from signid.types import Array, Indices

SOLVERS = ("pseudo-inverse", "factor")


def beam(
    problem: SignProblem, order: Indices, start: int, width: int = TREE_WIDTH, solve: str = "pseudo-inverse"
) -> TreeResult:
    """Search the tree with linear least squares at every node; an undetermined sign is arbitrary.

    Args:
        problem: segments of the problem.
        order: order of the segments in the tree (S,).
        start: number of segments before nodes are dropped.
        width: number of nodes kept per level.
        solve: "pseudo-inverse" of the Gram matrix for every node, or "factor" once per level, with the same result.

    Raises:
        OptionError: `solve` is unknown, or the width is not positive.
    """
    if solve not in SOLVERS:
        raise OptionError(f"unknown solver {solve!r}; choose from {', '.join(SOLVERS)}")
    node, nodes = grow(problem, order, start, width, _by_pseudo_inverse if solve == SOLVERS[0] else _by_factor)
    signs = in_place(node.signs, order)
    return TreeResult(signs, problem.back @ problem.coordinates(signs), node.loss, nodes, nodes)


def _by_pseudo_inverse(level: TreeLevel, right: Array) -> TreeNode:
    z = np.linalg.pinv(level.gram, rcond=LEVEL_ROUNDING, hermitian=True) @ right
    return TreeNode(max(level.energy - float(right @ z), 0.0), z, 1)


def _by_factor(level: TreeLevel, right: Array) -> TreeNode:
    z = level.turn @ right
    return TreeNode(max(level.energy - float(z @ z), 0.0), z, 1)
