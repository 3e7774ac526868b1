"""Branch and bound over signs: level by level, one factorisation for all nodes of a level."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...deadline import time_is_up
from ...types import Array, Frozen, Indices
from .problem import SignProblem

SEARCH = "the search for signs"
WIDEST = 10_000  # nodes kept of a level
MOST = 500_000  # nodes looked at; from then on few are kept of a level
FEW = 50
SAMPLE = 16  # nodes of a level that its parabolas are fitted to
SWEEPS = 4  # of the cuts, when what they cost together is judged
PIVOT = 1e-3  # of a factor, at least: rounding errors of bounds stay far below
ROUNDING = 1e-11  # share of the total energy: losses that differ by less are the same


@dataclass(frozen=True, eq=False)
class BranchResult(Frozen):
    """Where a tree ended. Losses are those of the problem, with what the cuts add."""

    leaves: Array  # (K, S) [1] signs of lower loss than the limit, the best first
    beyond: float  # signs that are no leaf have at least this loss: proved [squared standard deviations]
    nodes: int  # looked at


def branch(
    problem: SignProblem,
    incumbent: Array,
    window: float = 0.0,
    cuts: Array | None = None,
    z: Array | None = None,
    widest: int = WIDEST,
    most: int = MOST,
) -> BranchResult:
    """All signs whose loss is below that of the incumbent plus a window, or the best of them.

    A node has the signs of the first segments of an order, g = sum s_i b_i of them. J(s) is the minimum over z of
    E + |z|^2 - 2 sum s_i b_i'z. For a later segment, 2 |b_i'z| <= m_i + (b_i'z)^2 / m_i, a parabola for any m_i > 0:
    all leaves lose at least E - sum m_i + min z'Mz - 2 g'z with M = 1 - sum b_i b_i' / m_i, where M is positive
    definite. It is for m_i = T_i; from there the m_i climb to what is best for the nodes of the level, on average. The
    nodes left are judged again by parabolas that touch at z: about there, nothing is lost.

    Where a level has more nodes than may be kept, those of lowest bound are; the lowest bound that was dropped stays a
    proven bound. Of s and -s only one is looked at, unless a sign is known or cuts tell one from the other.

    Args:
        problem: the boolean least squares.
        incumbent: (S,) [1] signs to beat.
        window: [squared standard deviations] added to the incumbent's loss.
        cuts: (r, C) [1] directions c with c'z <= 0 for all z allowed: a loss rises by what they cost.
        z: (r,) [standard deviations] coordinates that losses near the limit have; None: the incumbent's.
        widest: nodes kept of a level.
        most: nodes looked at before only a few are kept of a level.
    """
    cuts = np.zeros((len(problem.projections), 0)) if cuts is None else cuts
    below = problem.loss(incumbent) + window
    tree = _Tree(problem, cuts, problem.coordinates(incumbent) if z is None else z, below)
    while tree.level < problem.count and len(tree.sums):
        tree.grow(widest if tree.nodes < most and not time_is_up(SEARCH) else min(FEW, widest))
    leaves = tree.leaves()
    losses = bounds(problem, leaves, cuts)
    kept = np.argsort(losses, kind="stable")[: int(np.sum(losses <= below))]
    return BranchResult(leaves[kept], max(min(below, tree.dropped), 0.0), tree.nodes)


def bounds(problem: SignProblem, signs: Array, cuts: Array) -> Array:
    """(K,) losses, with what the cuts add [squared standard deviations].

    Args:
        problem: the boolean least squares.
        signs: (K, S) [1].
        cuts: (r, C) [1].
    """
    plain = _Relaxed(np.zeros(0), np.eye(len(problem.projections)))
    return np.maximum(plain.floors(float(problem.energies.sum()), signs @ problem.projections.T, cuts), 0.0)


class _Relaxed(NamedTuple):
    """Parabolas for the later segments of a level."""

    heights: Array  # (n,) m
    factor: Array  # (r, r) of M

    def floors(self, energy: float, sums: Array, cuts: Array) -> Array:
        """(W,) what all leaves of nodes lose at least."""
        own, planes = self._half(sums.T), self._half(cuts)
        prices = _prices(planes, own)
        own -= planes @ prices
        return np.asarray(energy - self.heights.sum() - np.einsum("rw,rw->w", own, own))

    def solve(self, sums: Array, cuts: Array) -> Array:
        """(r, W) the z at which nodes lose that."""
        from scipy.linalg import solve_triangular

        own, planes = self._half(sums.T), self._half(cuts)
        own -= planes @ _prices(planes, own)
        return np.asarray(solve_triangular(self.factor, own, trans="T", lower=True, check_finite=False))

    def _half(self, columns: Array) -> Array:
        if not columns.size:
            return np.zeros(columns.shape)
        from scipy.linalg import solve_triangular

        return np.asarray(solve_triangular(self.factor, columns, lower=True, check_finite=False))


def _prices(planes: Array, own: Array) -> Array:
    """(C, W) multipliers, not negative, that make own - planes @ prices short: coordinate descent, a few rounds."""
    gram, inner = planes.T @ planes, planes.T @ own
    prices = np.zeros(inner.shape)
    for _ in range(SWEEPS):
        for k, row in enumerate(gram):
            prices[k] = np.maximum(prices[k] + (inner[k] - row @ prices) / row[k], 0.0)
    return prices


class _Tree:
    """The nodes of one level, and how they came about."""

    def __init__(self, problem: SignProblem, cuts: Array, z: Array, below: float) -> None:
        self.order = _branching_order(problem, z)
        self.cuts = cuts
        self.energy = float(problem.energies.sum())
        self.below = below - ROUNDING * self.energy
        self.one_sided = problem.anchored or not cuts.shape[1]  # the first segment has sign +1
        self.b = problem.projections[:, self.order]
        self.least = 1e-16 * max(self.energy, 1e-280)
        self.high = (1 + 1e-4) * problem.energies[self.order] + self.least  # M is positive definite, and not just so
        self.heights, self.touching = self.high.copy(), np.abs(self.b.T @ z) + self.least
        self.sums = np.zeros((1, len(self.b)))  # (W, r) of s_i b_i
        self.floors = np.zeros(1)
        self.dropped = np.inf
        self.level = self.nodes = 0
        self.came: list[tuple[Indices, NDArray[np.int8]]] = []  # parent and sign of each node kept, per level

    def grow(self, widest: int) -> None:
        """Both children of every node; those that may lead below the limit are kept."""
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
        self.came.append((alive % len(self.floors), signs[alive // len(self.floors)]))
        self.sums, self.floors = sums[alive], floors[alive]

    def leaves(self) -> Array:
        """(K, S) signs of the nodes of the last level."""
        found = np.empty((len(self.sums), len(self.order)))
        at = np.arange(len(self.sums))
        for i, (parent, signs) in zip(self.order[: self.level][::-1], self.came[::-1], strict=True):
            found[:, i] = signs[at]
            at = parent[at]
        return found

    def _fitted(self, sums: Array) -> _Relaxed:
        """One step of ascent of the mean bound over some nodes; ten at the first level."""
        later = self.b[:, self.level :]
        some = sums[np.unique(np.linspace(0, len(sums) - 1, SAMPLE).astype(int))]
        best = _relax(later, self.heights[self.level :]) or _relax(later, self.high[self.level :])
        assert best is not None, "parabolas as high as the energies leave M positive definite"
        value = float(best.floors(self.energy, some, self.cuts).mean())
        for _ in range(10 if self.level == 1 else 1):
            step = np.sqrt(np.mean((later.T @ best.solve(some, self.cuts)) ** 2, 1)) - best.heights
            for share in (1.0, 0.3, 0.1):
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
    """The segments (S,), a known one first, then those that matter much and are uncertain.

    |b_i| is what a sign can do, |b_i| / |b_i'z| how easily it turns round where the parameters are about z (r,). What
    comes late in a tree is what its bounds may then take as good as known.
    """
    size = np.linalg.norm(problem.projections, axis=0)
    clear = np.abs(problem.projections.T @ z)
    score = size**3 / np.maximum(clear, 1e-12 * np.max(size, initial=1e-300) ** 2)
    if problem.anchored:
        score[-1] = np.inf
    return np.argsort(-score, kind="stable")


def _relax(later: Array, heights: Array) -> _Relaxed | None:
    """Parabolas of these heights, unless M is singular or not positive definite."""
    from scipy.linalg import LinAlgError, cholesky  # here, because signs are rarely sought and it takes long to import

    scaled = later / np.sqrt(heights)
    try:
        factor = cholesky(np.eye(len(later)) - scaled @ scaled.T, lower=True, check_finite=False)
    except LinAlgError:
        return None
    return _Relaxed(heights, factor) if np.diag(factor).min(initial=1.0) > PIVOT else None
