"""Branch and bound over signs: breadth first, with one factorisation for all nodes of a level."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...deadline import time_is_up
from ...types import Array, Frozen, Indices
from .problem import SignProblem

SEARCH = "the search for signs"  # name of the search in the flag of the time limit
FEW = 50  # [nodes per level] kept once the budget of nodes or time is spent; heuristic
SAMPLE = 16  # [nodes per level] to which the parabolas are fitted; heuristic
SWEEPS = 4  # [sweeps] of coordinate descent over the cuts; any number gives a valid bound; heuristic
PIVOT = 1e-3  # [1] smallest pivot of a factor, so that rounding errors of bounds stay far below ROUNDING; heuristic
MARGIN = 1e-4  # [T_i] by which the first heights exceed T_i, so that M is clearly positive definite; heuristic
ASCENT_STEPS = 10  # [steps] of the heights at the first level; one at each later level; heuristic
STEP_SHARES = (1.0, 0.3, 0.1)  # [full step] tried in turn until the mean bound rises; heuristic
ROUNDING = 1e-11  # [total energy] losses that differ by less count as equal; heuristic


class TreeBudget(NamedTuple):
    """Limits of a tree search; the defaults are heuristic."""

    width: int = 10_000  # nodes kept per level
    nodes: int = 500_000  # nodes examined before only a few are kept per level


BUDGET = TreeBudget()


class Incumbent(NamedTuple):
    """Signs to beat, and what is known about the solution near them."""

    signs: Array  # (S,) s [1]
    coordinates: Array | None = None  # (r,) z of losses near the limit [standard deviations]; None: B s
    cuts: Array | None = None  # (r, C) [1] normals c with c'z <= 0 for every z allowed; None: no cuts


@dataclass(frozen=True, eq=False)
class BranchResult(Frozen):
    """Leaves of a tree. Losses are J(s) plus the lower bound on the squared distance that the cuts give."""

    leaves: Array  # (K, S) s [1] of lower loss than the limit, ascending
    beyond: float  # proven lower bound on the loss of all signs that are no leaf [squared standard deviations]
    nodes: int  # examined


def branch(
    problem: SignProblem, incumbent: Incumbent, window: float = 0.0, budget: TreeBudget = BUDGET
) -> BranchResult:
    """Find all signs whose loss is below that of the incumbent plus a window, or the best of them.

    A node fixes the signs of the first segments of an order; g = sum s_i b_i over them. J(s) is the minimum over z of E
    + |z|^2 - 2 sum_i s_i b_i'z with E = sum_i T_i. For a later segment, 2 |b_i'z| <= m_i + (b_i'z)^2 / m_i for any m_i
    > 0, a parabola. So all leaves of the node lose at least E - sum m_i + min_z (z'Mz - 2 g'z) with M = 1 - sum b_i
    b_i' / m_i, sums over later segments, if M is positive definite. It is for m_i > T_i; from there the heights m_i
    ascend the mean bound of the nodes of a level. Nodes that remain are bounded again with parabolas that touch at z,
    where this relaxation is tight.

    A level keeps the nodes of lowest bound within the budget; the lowest bound dropped remains a proven bound. Only one
    of s and -s is examined, unless a sign is known or there are cuts, which distinguish them. The window is in squared
    standard deviations.
    """
    cuts = np.zeros((len(problem.projections), 0)) if incumbent.cuts is None else incumbent.cuts
    z = problem.coordinates(incumbent.signs) if incumbent.coordinates is None else incumbent.coordinates
    below = problem.loss(incumbent.signs) + window
    tree = _Tree(problem, cuts, z, below)
    while tree.level < problem.count and len(tree.sums):
        spent = tree.nodes >= budget.nodes or time_is_up(SEARCH)
        tree.grow(min(FEW, budget.width) if spent else budget.width)
    leaves = tree.leaves()
    losses = bounds(problem, leaves, cuts)
    kept = np.argsort(losses, kind="stable")[: int(np.sum(losses <= below))]
    return BranchResult(leaves[kept], max(min(below, tree.dropped), 0.0), tree.nodes)


def bounds(problem: SignProblem, signs: Array, cuts: Array) -> Array:
    """Lower bounds (K,) on J_c(s) [squared standard deviations] of signs (K, S) [1], by cuts (r, C) [1]."""
    plain = _Relaxed(np.zeros(0), np.eye(len(problem.projections)))
    return np.maximum(plain.floors(float(problem.energies.sum()), signs @ problem.projections.T, cuts), 0.0)


class _Relaxed(NamedTuple):
    """Parabolas that replace the absolute values of the later segments of a level."""

    heights: Array  # (n,) m
    factor: Array  # (r, r) of M

    def floors(self, energy: float, sums: Array, cuts: Array) -> Array:
        """(W,) lower bounds on the loss of all leaves of W nodes with sums g (W, r)."""
        own = self._outside(sums, cuts)
        return np.asarray(energy - self.heights.sum() - np.einsum("rw,rw->w", own, own))

    def solve(self, sums: Array, cuts: Array) -> Array:
        """(r, W) minimisers z of the lower bounds."""
        from scipy.linalg import solve_triangular

        own = self._outside(sums, cuts)
        return np.asarray(solve_triangular(self.factor, own, trans="T", lower=True, check_finite=False))

    def _outside(self, sums: Array, cuts: Array) -> Array:
        """(r, W) half-solved sums less planes @ prices; a few sweeps over prices >= 0 make them short."""
        own, planes = self._half(sums.T), self._half(cuts)
        gram, inner = planes.T @ planes, planes.T @ own
        prices = np.zeros(inner.shape)
        for _ in range(SWEEPS):
            for k, row in enumerate(gram):
                prices[k] = np.maximum(prices[k] + (inner[k] - row @ prices) / row[k], 0.0)
        own -= planes @ prices
        return own

    def _half(self, columns: Array) -> Array:
        if not columns.size:
            return np.zeros(columns.shape)
        from scipy.linalg import solve_triangular

        return np.asarray(solve_triangular(self.factor, columns, lower=True, check_finite=False))


class _Tree:
    """Nodes of the current level, and their ancestors."""

    def __init__(self, problem: SignProblem, cuts: Array, z: Array, below: float) -> None:
        self.order = _branching_order(problem, z)
        self.cuts = cuts
        self.energy = float(problem.energies.sum())
        self.below = below - ROUNDING * self.energy
        self.one_sided = problem.anchored or not cuts.shape[1]  # the first segment has sign +1 only
        self.b = problem.projections[:, self.order]
        self.least = 1e-16 * max(self.energy, 1e-280)
        self.high = (1 + MARGIN) * problem.energies[self.order] + self.least
        self.heights, self.touching = self.high.copy(), np.abs(self.b.T @ z) + self.least
        self.sums = np.zeros((1, len(self.b)))  # (W, r) g
        self.floors = np.zeros(1)
        self.dropped = np.inf
        self.level = self.nodes = 0
        self.ancestors: list[tuple[Indices, NDArray[np.int8]]] = []  # parent and sign of each node kept, per level

    def grow(self, widest: int) -> None:
        """Replace every node by its children whose bound is below the limit, at most `widest`."""
        signs = np.array([1, -1][: 1 if self.level == 0 and self.one_sided else 2], dtype=np.int8)
        sums = (self.sums + signs[:, None, None] * self.b[:, self.level]).reshape(-1, len(self.b))
        floors = np.tile(self.floors, len(signs))
        self.level += 1
        self.nodes += len(floors)
        floors = np.maximum(floors, self._fitted(sums).floors(self.energy, sums, self.cuts))
        alive = np.flatnonzero(floors < self.below)
        touching = _relax(self.b[:, self.level :], self.touching[self.level :])
        if touching is not None and len(alive):
            floors[alive] = np.maximum(floors[alive], touching.floors(self.energy, sums[alive], self.cuts))
            alive = alive[floors[alive] < self.below]
        if len(alive) > widest:
            apart = np.argpartition(floors[alive], widest)
            self.dropped = min(self.dropped, float(floors[alive[apart[widest]]]))
            alive = np.sort(alive[apart[:widest]])
        self.ancestors.append((alive % len(self.floors), signs[alive // len(self.floors)]))
        self.sums, self.floors = sums[alive], floors[alive]

    def leaves(self) -> Array:
        """(K, S) signs s of the nodes of the nodes of the last level."""
        found = np.empty((len(self.sums), len(self.order)))
        at = np.arange(len(self.sums))
        for i, (parent, signs) in zip(self.order[: self.level][::-1], self.ancestors[::-1], strict=True):
            found[:, i] = signs[at]
            at = parent[at]
        return found

    def _fitted(self, sums: Array) -> _Relaxed:
        """Parabolas after an ascent of the mean bound over some nodes."""
        later = self.b[:, self.level :]
        some = sums[np.unique(np.linspace(0, len(sums) - 1, SAMPLE).astype(int))]
        best = _relax(later, self.heights[self.level :]) or _relax(later, self.high[self.level :])
        assert best is not None, "parabolas as high as the energies leave M positive definite"
        value = float(best.floors(self.energy, some, self.cuts).mean())
        for _ in range(ASCENT_STEPS if self.level == 1 else 1):
            step = np.sqrt(np.mean((later.T @ best.solve(some, self.cuts)) ** 2, 1)) - best.heights
            for share in STEP_SHARES:
                trial = _relax(later, np.maximum(best.heights + share * step, self.least))
                reached = -np.inf if trial is None else float(trial.floors(self.energy, some, self.cuts).mean())
                if trial is not None and reached > value:
                    best, value = trial, reached
                    break
            else:
                break
        self.heights[self.level :] = best.heights
        return best


def _branching_order(problem: SignProblem, z: Array) -> Indices:
    """Order of the segments (S,): a known one first, then descending |b_i|^3 / |b_i'z|.

    |b_i| is the influence of a sign, |b_i| / |b_i'z| its uncertainty near z (r,). The late segments have large
    |b_i'z|, where the relaxation is tight.
    """
    size = np.linalg.norm(problem.projections, axis=0)
    clear = np.abs(problem.projections.T @ z)
    score = size**3 / np.maximum(clear, 1e-12 * np.max(size, initial=1e-300) ** 2)
    if problem.anchored:
        score[-1] = np.inf
    return np.argsort(-score, kind="stable")


def _relax(later: Array, heights: Array) -> _Relaxed | None:
    """Parabolas of these heights (n,); None if M is not clearly positive definite."""
    from scipy.linalg import LinAlgError, cholesky  # imported here, since it takes long and signs are rarely needed

    scaled = later / np.sqrt(heights)
    try:
        factor = cholesky(np.eye(len(later)) - scaled @ scaled.T, lower=True, check_finite=False)
    except LinAlgError:
        return None
    return _Relaxed(heights, factor) if np.diag(factor).min(initial=1.0) > PIVOT else None
