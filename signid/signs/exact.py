"""Signs of lowest loss within the physical cone, from many starts of steepest ascent, and their rivals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..deadline import show_step, time_is_up
from ..types import Array, Frozen, Indices
from .branch_and_bound import BUDGET, LOSS_ROUNDING, SIGN_SEARCH, Incumbent, PhysicalCone, TreeBudget, bounds, branch
from .problem import SignProblem, certify
from .result import SignProof

CLIMB_STARTS = 150  # logs: a single start reaches the optimum in 2 to 60 % of the cases
START_VECTORS = 3  # leading singular vectors of B, and of B with unit columns, used as starts; heuristic
PAIRED_OPTIMA = 12  # best different local optima that are continued with flips of pairs; heuristic
MIN_FLIP_GAIN = 1e-12  # [total energy] smallest gain of a flip; rounding
MAX_SEGMENT_FLIPS = 20  # [flips per segment] at most, since rounding errors could go on for ever; heuristic
MAX_CUTS = 64  # half-spaces kept, since each bound costs a sweep over them; heuristic
MAX_BOUND_SHARE = 0.9  # [squared distance] of bounds by the half-spaces before one that is kept; heuristic
FIRST_TREE_WIDTH = 200  # [nodes per level] of the first trees; ten times as many once they give nothing new; heuristic
MAX_PATTERN_GROUPS = 9  # [groups of segments] up to which all patterns of flips are tried: 2^8 patterns; heuristic
MAX_SCORED_LEAVES = 500  # [leaves per tree] whose distance from the cone is computed, about 1 ms each; heuristic
RIVALS = TreeBudget(width=1000)  # of the enumeration of rivals; its width also limits the distances computed; heuristic


def climb(problem: SignProblem, seed: int = 0) -> Array:
    """The best local optimum (S,) [1] of many starts; a known segment has sign +1."""
    # signs of leading singular vectors of B, plain and with unit columns; of random models; random signs
    rng = np.random.default_rng(seed)
    size = np.linalg.norm(problem.projections, axis=0)
    vectors = [
        np.linalg.svd(matrix, full_matrices=False)[2][:START_VECTORS]
        for matrix in (problem.projections, problem.projections / np.maximum(size, 1e-300))
    ]
    left = CLIMB_STARTS - 2 * START_VECTORS
    models = rng.normal(size=(left - left // 2, len(problem.projections))) @ problem.projections
    starts = np.concatenate([*vectors, models, rng.normal(size=(left // 2, problem.count))])
    ends = np.unique(ascend(problem, np.where(starts >= 0, 1.0, -1.0)), axis=0)
    losses = np.array([problem.loss(signs) for signs in ends])
    best = np.argsort(losses, kind="stable")[:PAIRED_OPTIMA]
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
    least = MIN_FLIP_GAIN * float(problem.energies.sum())
    groups = [np.flatnonzero(problem.joints == j) for j in np.unique(problem.joints)]
    active = np.arange(len(signs))
    for _ in range(MAX_SEGMENT_FLIPS * problem.count):
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


def _flip_single(gram: Array, signs: Array, pull: Array, least: float, active: Indices) -> None:
    size = np.diag(gram)
    for _ in range(MAX_SEGMENT_FLIPS * len(size)):
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


class Scores:
    """Loss J_c(s) = J(s) + dist^2(B s, cone) of all signs evaluated so far, and the best of them; cone None: all z.

    With p the point of the cone nearest to z, (z - p)'y <= 0 for every y in the cone: each distance gives a half-space
    (a cut) that bounds the distances of other signs from below. Signs of a loss above `limit` are skipped; None: signs
    worse than the best.
    """

    def __init__(
        self, problem: SignProblem, cone: PhysicalCone | None, limit: float | None = None, cuts: Array | None = None
    ) -> None:
        self.problem, self.cone, self._limit = problem, cone, limit
        self.same = LOSS_ROUNDING * float(problem.energies.sum())
        self.cuts = np.zeros((len(problem.projections), 0)) if cuts is None else cuts
        self.best, self.signs, self.coordinates = np.inf, np.zeros(0), np.zeros(0)
        self._seen: dict[bytes, float] = {}

    @property
    def limit(self) -> float:
        """Loss from which signs are skipped [squared standard deviations]."""
        return (self.best if self._limit is None else self._limit) + self.same

    def add(self, signs: Array, most: int | None = None) -> float:
        """Evaluate signs (K, S) [1] and their opposites, in the order of their lower bounds, up to the limit.

        About `most` distances are computed. Returns a lower bound on the losses that were left out though they may be
        below the limit; inf if there are none.
        """
        both = signs if self.problem.anchored else np.concatenate([signs, -signs])
        floors = bounds(self.problem, both, self.cuts)
        count = 0
        for k in np.argsort(floors, kind="stable").tolist():
            if floors[k] >= self.limit:
                break
            if most is not None and count >= most:
                return float(floors[k])
            count += self._add(both[k])
        return np.inf

    def attained(self) -> bool:
        """Whether the coordinates of the best signs lie in the cone, so that their loss is more than a lower bound."""
        return self._distance(self.coordinates)[0] <= self.same

    def ranked(self) -> tuple[Array, Array]:
        """All evaluated signs (K, S) [1] and their losses (K,) [squared standard deviations], ascending."""
        losses = np.array(list(self._seen.values()))
        at = np.argsort(losses, kind="stable")
        signs = np.array([np.frombuffer(key, dtype=np.int8) for key in self._seen], dtype=float)
        return signs[at], losses[at]

    def _distance(self, z: Array) -> tuple[float, Array]:
        return (0.0, z) if self.cone is None else self.cone.distance(z)

    def _add(self, signs: Array) -> bool:
        """Evaluate signs (S,), unless they were evaluated before or are bounded above the limit."""
        key = signs.astype(np.int8).tobytes()
        if key in self._seen:
            return False
        loss = self.problem.loss(signs)
        bound = float(bounds(self.problem, signs[None], self.cuts)[0]) - loss  # on the squared distance, by the cuts
        if loss + bound >= self.limit:
            return False
        z = self.problem.coordinates(signs)
        squared, nearest = self._distance(z)
        self._seen[key] = loss + squared
        if loss + squared < self.best:
            self.best, self.signs, self.coordinates = loss + squared, np.array(signs), nearest
        if squared > self.same and bound < MAX_BOUND_SHARE * squared and self.cuts.shape[1] < MAX_CUTS:
            self.cuts = np.column_stack([self.cuts, (z - nearest) / np.linalg.norm(z - nearest)])
        return True


@dataclass(frozen=True, eq=False)
class SignSolution(Frozen):
    """The best signs s within the cone; their loss is J_c(s) = J(s) + dist^2(B s, cone)."""

    signs: Array  # (S,) s [1]
    coordinates: Array  # (r,) z, inside the cone [standard deviations]
    loss: float  # [squared standard deviations]
    proof: SignProof
    cuts: Array  # (r, C) [1] normals c with c'z <= 0 in the cone


class RivalSigns(NamedTuple):
    """Signs almost as good as the best, itself included; s and -s are different rivals."""

    signs: Array  # (K, S) s [1]
    losses: Array  # (K,) J_c(s), ascending [squared standard deviations]
    complete: bool  # whether there are provably no others

    @property
    def weights(self) -> Array:
        """(K,) posterior weights exp(-J_c/2), relative to the best rival [1]."""
        return np.asarray(np.exp(-(self.losses - self.losses.min(initial=np.inf)) / 2))


def search_signs(
    problem: SignProblem,
    cone: PhysicalCone | None = None,
    moves: Sequence[Array] = (),
    start: Array | None = None,
    *,
    seed: int = 0,
    budget: TreeBudget = BUDGET,
) -> SignSolution:
    """Find the signs of lowest loss.

    Without a cone: local search from many starts, certificate, else branch and bound. With a cone: flips of joints and
    segments from there, then branch and bound in which half-spaces that contain the cone raise the bounds. If a budget
    ends the search, the proof states the remaining gap. Where s and -s have the same loss, either may be returned.

    The signs start (S,) [1] may be good. The segments of a joint may have the signs of moves (S,) [1] together, or be
    multiplied by them; 0: no proposal. Moves may leave the known segment out.
    """
    tries = climb(problem, seed=seed)[None]
    if start is not None:
        tries = np.concatenate([tries, start[None], ascend(problem, start[None], pairs=True)])
    free = Scores(problem, None)
    free.add(tries)
    lower, certified = certify(problem, free.signs)
    lower, nodes = _prove_bound(free, (), free.best if certified else lower, budget)
    scores = free
    if cone is not None:
        scores = Scores(problem, cone)
        scores.add(np.concatenate([free.signs[None], tries]))
        lower, more = _prove_bound(scores, moves, lower, budget)
        nodes += more
    attained = scores.attained()
    optimal = attained and scores.best - lower <= scores.same
    gap = 0.0 if optimal else 1 - max(lower, 0.0) / scores.best if attained else 1.0
    proof = SignProof(optimal, gap, nodes, certified=optimal and not nodes)
    return SignSolution(scores.signs, scores.coordinates, scores.best, proof, scores.cuts)


def enumerate_near(
    problem: SignProblem, cone: PhysicalCone | None, solution: SignSolution, window: float, budget: TreeBudget = RIVALS
) -> RivalSigns:
    """List all signs whose loss exceeds that of a solution by at most a window; the best ones if there are too many.

    The window is in squared standard deviations. The width of the budget also limits the number of distances computed.
    """
    limit = solution.loss + window
    scores = Scores(problem, cone, limit, solution.cuts)
    scores.add(solution.signs[None])
    best = Incumbent(solution.signs, solution.coordinates, solution.cuts)
    tree = branch(problem, best, limit - problem.loss(solution.signs), budget)
    beyond = min(tree.beyond, scores.add(tree.leaves, budget.width))
    signs, losses = scores.ranked()
    inside = losses <= limit + scores.same
    return RivalSigns(signs[inside], losses[inside], beyond >= limit - scores.same)


def _prove_bound(scores: Scores, moves: Sequence[Array], lower: float, budget: TreeBudget) -> tuple[float, int]:
    """Grow trees, each from the best signs and cuts of those before; returns the lower bound proved, and the nodes."""
    nodes, width = 0, min(FIRST_TREE_WIDTH, budget.width)
    if scores.best - lower > scores.same:
        _improve_signs(scores, moves)
    while scores.best - lower > scores.same and nodes < budget.nodes and not time_is_up(SIGN_SEARCH):
        show_step("searching signs", nodes / budget.nodes)
        before = scores.best, scores.cuts.shape[1]
        window = scores.best - scores.problem.loss(scores.signs)
        best = Incumbent(scores.signs, scores.coordinates, scores.cuts)
        tree = branch(scores.problem, best, window, TreeBudget(width, budget.nodes - nodes))
        rest = min(tree.beyond, scores.add(tree.leaves, MAX_SCORED_LEAVES))
        lower = max(lower, min(rest, scores.best))
        nodes += tree.nodes
        _improve_signs(scores, moves)
        if (scores.best, scores.cuts.shape[1]) == before:
            if width == budget.width:
                break
            width = min(10 * width, budget.width)
    return lower, nodes


def _improve_signs(scores: Scores, moves: Sequence[Array]) -> None:
    """Flip joints, apply moves, flip segments, until the loss no longer falls, for MAX_SEGMENT_FLIPS rounds at most."""
    problem = scores.problem
    for _ in range(MAX_SEGMENT_FLIPS):
        if time_is_up(SIGN_SEARCH):
            break
        before = scores.best
        for starts in (_joint_flips(scores), _moved_signs(scores, moves)):
            scores.add(np.concatenate([starts, ascend(problem, starts, joints=False)]))
        flips = 1 - 2 * np.eye(problem.count)[: problem.count - int(problem.anchored)]
        for _ in range(MAX_SEGMENT_FLIPS * problem.count):
            start = scores.best
            scores.add(scores.signs * flips)
            if scores.best >= start - scores.same:
                break
        if scores.best >= before - scores.same:
            break


def _joint_flips(scores: Scores) -> Array:
    """(K, S) the best signs with joints flipped: all patterns of a few joints, else single joints and pairs."""
    problem, signs = scores.problem, scores.signs
    groups, at = np.unique(problem.joints, return_inverse=True)  # a known segment is the first group
    count = len(groups)
    if count <= MAX_PATTERN_GROUPS:
        flips = (np.arange(2 ** (count - 1))[:, None] >> np.arange(count - 1)) & 1
        flips = np.column_stack([np.zeros(len(flips), dtype=int), flips])
    else:
        single = np.eye(count, dtype=int)[int(problem.anchored) :]
        flips = np.unique((single[:, None] | single).reshape(-1, count), axis=0)
    return np.asarray(signs * (1.0 - 2.0 * flips[:, at]))


def _moved_signs(scores: Scores, moves: Sequence[Array]) -> Array:
    """(K, S) the best signs with those of one joint replaced by, or multiplied by, a move or its opposite."""
    problem, signs, moved = scores.problem, scores.signs, []
    for move in moves:
        move = np.append(move, np.zeros(problem.count - len(move)))
        for joint in np.unique(problem.joints):
            on_joint = (problem.joints == joint) & (joint >= 0)
            if on_joint.any() and move[on_joint].all():
                moved += [np.where(on_joint, sign * new, signs) for sign in (1, -1) for new in (move, signs * move)]
    return np.array(moved).reshape(-1, problem.count)
