"""Classical method: a tree of sign choices, each node solved by a search for standard parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations, islice, product
from math import comb
from typing import NamedTuple

import numpy as np

from ..errors import OptionError
from ..estimation.pbrp import Bounds, bounds_around, check_box, cost_over, descend, physics_of
from ..model import stated_parameters
from ..regression.rows import Task
from ..types import Array, BaseMap, Estimate, Frozen, Indices, Parameters, Progress
from .infer import ChooseSigns, SignChoice
from .observations import Segment
from .problem import SignProblem, certify
from .result import SignProof

ORDER_ROUNDING = 1e-14  # [largest eigenvalue of a Gram matrix] smaller eigenvalues are rounding errors
MAX_CONDITION = 1000.0  # [1] condition number of a well-conditioned first set; heuristic
EXHAUSTIVE_SIZE = 3  # [segments] up to which all sets are tried; heuristic
MAX_SETS = 20_000  # [sets] tried at most; heuristic
MAX_FIRST_SEGMENTS = 8  # [segments] chosen one by one, since a tree tries all 2^8 of their signs; heuristic
GRAM_BLOCK = 256  # [Gram matrices] decomposed at a time; bounds memory
MAX_GENERATED_RATIO = 100  # [sets generated per set tried], since few sets may have the joints needed; heuristic

_Set = tuple[int, ...]
TREE_WIDTH = 5  # [nodes per level] kept, as in the classical method
LEVEL_ROUNDING = 1e-13  # [largest eigenvalue of a Gram matrix] smaller eigenvalues are rounding errors
ROUND_PENALTY = 10.0  # [squared standard deviations] penalty per round
MIN_NOTED_EXCESS = 0.01  # [loss of least squares with the same signs] of the best node; heuristic
NEGLIGIBLE_EXCESS = 1e-6  # [total energy] excess loss that is never noted; heuristic
SHOWN_SHARE = 1e-3  # [information of all joints] smallest of a joint that shows a parameter; heuristic
TREE_NOTE = (
    "signs were searched by the classical tree ({nodes} nodes, {evaluations} evaluations), which keeps few nodes per "
    "level and proves nothing; samples below the threshold follow the model that it found"
)


class SegmentOrder(NamedTuple):
    """Order in which a tree takes the segments."""

    order: Indices  # (S,)
    start: int  # segments of the first set, of which all signs are tried
    condition: float  # condition number of the first set's stacked rows; infinite if they are rank deficient
    complete: bool  # whether all sets of that size and of smaller ones were tried


def condition_order(problem: SignProblem, threshold: float = MAX_CONDITION, budget: int = MAX_SETS) -> SegmentOrder:
    """Order the segments: the smallest set whose stacked rows are well conditioned, then greedily.

    Each later segment is the one that gives the smallest condition number with all before it, over base parameters in
    their own units. All sets of one, two ... EXHAUSTIVE_SIZE segments are tried, `budget` sets at most; if a limit ends
    that, the first set is chosen one segment at a time and `complete` is False. Friction of a joint acts in its own
    segments only, so seven joints need at least seven segments, and 93 segments have 1e10 such sets. A segment of
    known sign comes first.

    Source: the condition number as a measure of excitation: Gautier, Khalil, Int. J. Robotics Research 11(4), 1992.
    """
    left, size, _ = np.linalg.svd(np.linalg.pinv(problem.back), full_matrices=False)
    turn, unknown = left * size, problem.count - problem.anchored
    grams = turn.T @ problem.grams @ turn  # (S, r, r) with the eigenvalues over base parameters in their own units
    known = tuple(range(unknown, problem.count))
    first, complete = _min_set(grams, known, problem.joints[:unknown], threshold, budget)
    if first is None:
        first = _greedy_set(grams, known, unknown, threshold)[: len(known) + MAX_FIRST_SEGMENTS]
    lost, condition = _conditioning(grams[list(first)].sum(0)[None])
    order = np.array(_greedy_set(grams, first, unknown), dtype=np.intp)
    return SegmentOrder(order, len(first), np.inf if lost[0] else float(condition[0]), complete)


def _conditioning(grams: Array) -> tuple[Array, Array]:
    """Rank deficiency, and condition number of the rest, of (k, r, r) Gram matrices."""
    values = np.linalg.eigvalsh(grams)
    lost = (values <= ORDER_ROUNDING * values[:, -1:]).sum(1)
    least = np.take_along_axis(values, np.minimum(lost, values.shape[1] - 1)[:, None], 1)[:, 0]
    return lost, np.sqrt(np.maximum(values[:, -1], 0.0) / np.maximum(least, 1e-300))


def _min_set(grams: Array, known: _Set, joints: Indices, threshold: float, budget: int) -> tuple[_Set | None, bool]:
    """Best set of the smallest size that has a well-conditioned one, and whether all sets up to it were tried."""
    base, total, joint_of_segment = grams[list(known)].sum(0), grams.sum(0), joints.tolist()
    rest = [(j, total - grams[: len(joints)][joints == j].sum(0)) for j in np.unique(joints).tolist()]
    needed = {j for j, gram in rest if _conditioning(gram[None])[0][0] > 0}  # without them rows are rank deficient
    for size in range(0 if known else 1, min(EXHAUSTIVE_SIZE, len(joints)) + 1):
        if size < len(needed):
            continue
        if comb(len(joints), size) > MAX_GENERATED_RATIO * budget:
            return None, False
        sets = (s for s in combinations(range(len(joints)), size) if needed <= {joint_of_segment[i] for i in s})
        taken = list(islice(sets, budget + 1))
        if len(taken) > budget:
            return None, False
        budget -= len(taken)
        tried: list[tuple[int, float, _Set]] = []
        for k in range(0, len(taken), GRAM_BLOCK):
            block = taken[k : k + GRAM_BLOCK]
            lost, condition = _conditioning(base + grams[np.array(block, dtype=np.intp)].sum(1))
            tried += zip(lost.tolist(), condition.tolist(), block, strict=True)
        best = min(tried, default=(0, np.inf, ()))
        if taken and best[0] == 0 and best[1] < threshold:
            return (*known, *best[2]), True
    return None, EXHAUSTIVE_SIZE >= len(joints)


def _greedy_set(grams: Array, first: _Set, unknown: int, threshold: float = 0.0) -> _Set:
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

    The segments are taken in order (S,). All signs of the first `start` of them are tried before nodes are dropped.

    Raises:
        OptionError: the width is not positive.
    """
    if width < 1:
        raise OptionError(f"a tree cannot keep {width} nodes a level; keep at least 1")
    choices = [(1.0,) if problem.joints[i] < 0 else (1.0, -1.0) for i in order]
    pool, nodes, spent = [TreeNode(0.0, np.zeros(0), 0)], 0, 0
    for k in range(max(start, 1), len(order) + 1):
        taken = order[:k]
        gram, right = problem.grams[taken].sum(0), problem.projections[:, taken]
        values, axes = np.linalg.eigh(gram)
        seen = values > LEVEL_ROUNDING * values[-1]
        size, axes = np.sqrt(values[seen])[:, None], axes[:, seen].T
        level = TreeLevel(gram, size * axes, axes / size, float(problem.energies[taken].sum()))
        tried = [(*node.signs, *more) for node in pool for more in product(*choices[len(node.signs) : k])]
        solved = [solve(level, right @ np.array(signs))._replace(signs=signs) for signs in tried]
        nodes, spent = nodes + len(solved), spent + sum(node.evaluations for node in solved)
        pool = sorted(solved, key=lambda node: node.loss)[:width]
        if progress is not None:
            progress("growing the tree of signs", k / len(order))
    return pool[0]._replace(evaluations=spent), nodes


def in_place(signs: Sequence[float], order: Indices) -> Array:
    """Signs (S,) by segment [1], from signs in the order of a tree."""
    out = np.empty(len(order))
    out[order] = signs
    return out


def search_tree(
    problem: SignProblem,
    base: BaseMap,
    prior: Parameters,
    bounds: Bounds | None = None,
    *,
    width: int = TREE_WIDTH,
    algorithm: str = "LN_SBPLX",
    restarts: int = 3,
    rounds: int = 3,
    budget: int = 1000,
    seed: int = 0,
    progress: Progress | None = None,
) -> TreeResult:
    """Find signs by a tree: all choices for a first set of segments, then two children per node, keeping the best.

    Segments are ordered by `condition_order`. Each node is solved by a local algorithm of NLopt over the standard
    parameters in a box (default: around the description), from random starts: first for the loss alone, then with a
    growing penalty on violations of physics, each round of `budget` evaluations from the end of the last. Its end moves
    to the nearest solution of linear least squares if that costs less. The loss of the stacked rows is evaluated on a
    factor of their Gram matrix.

    Raises:
        OptionError: unknown algorithm, or invalid width, restarts, rounds or bounds.
    """
    if restarts < 1 or rounds < 1:
        raise OptionError(f"{restarts} starts of {rounds} rounds solve nothing; ask for at least 1 of each")
    into, joints = problem.forward, np.unique(problem.joints)
    grams = np.array([problem.grams[problem.joints == j].sum(0) for j in joints])
    energies = np.array([problem.energies[problem.joints == j].sum() for j in joints])
    shown = np.einsum("ri,jrs,si->ji", into, grams, into)
    alone = np.where(shown > SHOWN_SHARE * shown.sum(0), energies[:, None] / np.maximum(shown, 1e-300), np.inf)
    least_energy = alone.min(0)
    size = np.sqrt(np.where(np.isfinite(least_energy), least_energy, 0.0))
    nothing = np.zeros((base.rank, base.rank))
    scales = Estimate(size, nothing, nothing, np.zeros(0), ())
    box = bounds_around(base, scales, prior) if bounds is None else bounds
    check_box(box, base)
    physics = physics_of(base, scales, prior)
    standard, rng = problem.forward @ base.combination, np.random.default_rng(seed)
    weights = (ROUND_PENALTY * np.arange(rounds)).tolist()

    def solve(level: TreeLevel, right: Array) -> TreeNode:
        target = level.turn @ right
        cost = cost_over(box, physics, level.root @ standard, target, max(level.energy - float(target @ target), 0.0))
        starts = rng.uniform(size=(restarts, len(cost.free)))
        ends = [descend(cost, start, weights, algorithm, budget, seed) for start in starts]
        best_end = min(ends, key=lambda end: end.value)
        # with known signs the residual is linear: a search that stops beside its optimum is moved there, in the box
        step = np.linalg.lstsq(cost.matrix, cost.target - cost.matrix @ best_end.x, rcond=LEVEL_ROUNDING**0.5)[0]
        moved = np.clip(best_end.x + step, 0.0, 1.0)
        value = cost.problem(moved, weights[-1]).objective(moved)
        x, loss = (moved, value) if value < best_end.value else (best_end.x, best_end.value)
        return TreeNode(loss, cost.standard(x), sum(end.evaluations for end in ends))

    ordered = condition_order(problem)
    node, nodes = grow(problem, ordered.order, ordered.start, width, solve, progress)
    signs = in_place(node.signs, ordered.order)
    notes, least = [], problem.loss(signs)
    if not ordered.complete:
        notes.append(
            f"the first {ordered.start} segments of the tree were chosen one by one (condition number "
            f"{ordered.condition:.3g}), since there are too many sets or signs to try them all"
        )
    if node.loss > (1 + MIN_NOTED_EXCESS) * least + NEGLIGIBLE_EXCESS * problem.energies.sum():
        notes.append(
            f"the search at the last node ended at a loss of {node.loss:.3g}, but least squares with the same signs "
            f"reaches {least:.3g}, so its signs may be wrong; --signs exact needs no such search"
        )
    return TreeResult(signs, base.combination @ node.end, node.loss, nodes, node.evaluations, tuple(notes))


def by_tree(task: Task, seed: int, progress: Progress | None = None) -> ChooseSigns:
    """Search by the tree of sign choices, each node solved over the standard parameters."""

    def choose(problem: SignProblem, segments: Sequence[Segment]) -> SignChoice:
        grown = search_tree(problem, task.base, stated_parameters(task), seed=seed, progress=progress)
        loss, (lower, optimal) = problem.loss(grown.signs), certify(problem, grown.signs)
        gap = 0.0 if optimal or loss <= 0 else min(max(1 - lower / loss, 0.0), 1.0)
        note = TREE_NOTE.format(nodes=grown.nodes, evaluations=grown.evaluations)
        proof = SignProof(optimal, gap, grown.nodes, optimal)
        return SignChoice(grown.signs, problem.coordinates(grown.signs), proof, (note, *grown.notes))

    return choose
