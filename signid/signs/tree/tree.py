"""Classical method: a tree of sign choices, each node solved by a search for standard parameters."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...errors import OptionError
from ...estimation.pbrp import Bounds, bounds_around
from ...estimation.pbrp.bounds import check_box
from ...estimation.pbrp.cost import cost_over, descend, physics_of
from ...types import Array, BaseMap, Estimate, Parameters, Progress
from ..search.problem import SignProblem
from .beam import WIDTH, TreeLevel, TreeNode, TreeResult, grow, in_place
from .condition import SegmentOrder, condition_order

EXCESS = 0.01  # [loss of least squares with the same signs] excess loss of the best node that is noted; heuristic
NEGLIGIBLE = 1e-6  # [total energy] excess loss that is never noted; heuristic
SHOWN = 1e-3  # [information of all joints on a parameter] share from which a joint counts as showing it; heuristic


def search_tree(
    problem: SignProblem,
    base: BaseMap,
    prior: Parameters,
    bounds: Bounds | None = None,
    *,
    forward: Array | None = None,
    total_mass: tuple[float, float] | None = None,
    width: int = WIDTH,
    algorithm: str = "LN_SBPLX",
    restarts: int = 3,
    rounds: int = 3,
    schedule: float = 10.0,
    budget: int = 1000,
    seed: int = 0,
    progress: Progress | None = None,
) -> TreeResult:
    """Find signs by a tree: all choices for a first set of segments, then two children per node, keeping the best.

    Segments are ordered by `condition_order`. Each node is solved by a local algorithm over the standard parameters in
    a box, from random starts: first for the loss alone, then with a growing penalty on violations of physics, each
    round from the end of the last. The loss of the stacked rows is evaluated on a factor of their Gram matrix.

    Args:
        problem: boolean least squares.
        base: base map.
        prior: standard parameters of the description, for the box and the scales.
        bounds: box; default: that of `box_of`.
        forward: (r, b) [standard deviations per unit of base] from base parameters to the coordinates of the problem;
            needed only if the segments do not identify all base parameters, r < b.
        total_mass: smallest and largest sum of the masses of all moving bodies [kg].
        width: nodes kept per level.
        algorithm: local algorithm of NLopt.
        restarts: random starts per node.
        rounds: rounds of growing penalty per start; the first has none.
        schedule: penalty per round [squared standard deviations].
        budget: evaluations per round.
        seed: seed of the starts.
        progress: called with the share of levels done.

    Raises:
        OptionError: unknown algorithm, or invalid width, restarts, rounds, bounds or range of mass.
        ValueError: the prior does not have the labels of the base map.
    """
    if restarts < 1 or rounds < 1:
        raise OptionError(f"{restarts} starts of {rounds} rounds solve nothing; ask for at least 1 of each")
    box = box_of(problem, base, prior, forward) if bounds is None else bounds
    check_box(box, base)
    physics = physics_of(base, _scales(problem, base, forward), prior, total_mass)
    standard, rng = _forward(problem, forward) @ base.combination, np.random.default_rng(seed)
    weights = (schedule * np.arange(rounds)).tolist()

    def solve(level: TreeLevel, right: Array) -> TreeNode:
        target = level.turn @ right
        cost = cost_over(box, physics, level.root @ standard, target, max(level.energy - float(target @ target), 0.0))
        starts = rng.uniform(size=(restarts, len(cost.free)))
        ends = [descend(cost, start, weights, algorithm, budget, seed) for start in starts]
        best = min(ends, key=lambda end: end.value)
        return TreeNode(best.value, cost.standard(best.x), sum(end.evaluations for end in ends))

    ordered = condition_order(problem)
    node, nodes = grow(problem, ordered.order, ordered.start, width, solve, progress)
    signs = in_place(node.signs, ordered.order)
    notes = (*_order_notes(ordered), *_loss_notes(problem, signs, node), *_rank_notes(problem, forward))
    return TreeResult(signs, base.combination @ node.end, node.loss, nodes, node.evaluations, notes)


def box_of(problem: SignProblem, base: BaseMap, prior: Parameters, forward: Array | None = None) -> Bounds:
    """Box around the description; law coefficients extend to three times what the absolute torque could need.

    Args:
        problem: boolean least squares.
        base: base map.
        prior: standard parameters of the description.
        forward: (r, b) [standard deviations per unit of base] as in `search_tree`.

    Raises:
        ValueError: the prior does not have the labels of the base map.
    """
    return bounds_around(base, _scales(problem, base, forward), prior)


def _forward(problem: SignProblem, forward: Array | None) -> Array:
    return np.asarray(np.linalg.pinv(problem.back)) if forward is None else forward


def _scales(problem: SignProblem, base: BaseMap, forward: Array | None) -> Estimate:
    """Scales of the base parameters: the value at which one alone makes the torque of a joint that depends on it."""
    into, joints = _forward(problem, forward), np.unique(problem.joints)
    grams = np.array([problem.grams[problem.joints == j].sum(0) for j in joints])
    energies = np.array([problem.energies[problem.joints == j].sum() for j in joints])
    shown = np.einsum("ri,jrs,si->ji", into, grams, into)
    alone = np.where(shown > SHOWN * shown.sum(0), energies[:, None] / np.maximum(shown, 1e-300), np.inf)
    least = alone.min(0)
    size = np.sqrt(np.where(np.isfinite(least), least, 0.0))
    nothing = np.zeros((base.rank, base.rank))
    return Estimate(size, nothing, nothing, np.zeros(0), ())


def _order_notes(ordered: SegmentOrder) -> Iterator[str]:
    if not ordered.complete:
        yield (
            f"the first {ordered.start} segments of the tree were chosen one by one (condition number "
            f"{ordered.condition:.3g}), since there are too many sets or signs to try them all"
        )


def _loss_notes(problem: SignProblem, signs: Array, node: TreeNode) -> Iterator[str]:
    least = problem.loss(signs)
    if node.loss > (1 + EXCESS) * least + NEGLIGIBLE * problem.energies.sum():
        yield (
            f"the search at the last node ended at a loss of {node.loss:.3g}, but least squares with the same signs "
            f"reaches {least:.3g}, so its signs may be wrong; --signs exact needs no such search"
        )


def _rank_notes(problem: SignProblem, forward: Array | None) -> Iterator[str]:
    unseen = len(problem.back) - problem.back.shape[1]
    if unseen and forward is None:
        yield f"{unseen} combinations of base parameters are identified by no segment; their minimum norm was taken"
