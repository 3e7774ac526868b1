"""Branch and bound over signs, within the cone of physical parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..deadline import time_is_up
from ..regression.motion import Motion, base_rows
from ..regression.rows import Task
from ..types import Array, Frozen, Indices
from .observations import Observations, law_coefficients
from .problem import SignProblem

OFFSET_LIMIT = 2.0  # [Coulomb friction] largest |offset|; logs: 0 to 0.8 with true signs, above 1e5 if the signs of a
# joint follow an offset instead of friction
KINETIC_POSES = 15  # configurations at which kinetic energy must be positive; logs: enough for Panda and UR10e
KINETIC_VELOCITIES = 4  # random joint velocities per configuration, beside those of each joint alone; as KINETIC_POSES
ZERO_ROW_LENGTH = 1e-9  # [sum of the absolute values of its terms] length of a row that is zero but for rounding
CONE_TOLERANCE = 1e-9  # [distance from the origin] violation of an inequality that is rounding error
BVLS_ROUNDS = 20  # [iterations per row] of the search for multipliers, at most; heuristic
SIGN_SEARCH = "the search for signs"  # name of the search in the flag of the time limit
SPENT_WIDTH = 50  # [nodes per level] kept once the budget of nodes or time is spent; heuristic
PARABOLA_NODES = 16  # [nodes per level] to which the parabolas are fitted; heuristic
CUT_SWEEPS = 4  # [sweeps] of coordinate descent over the cuts; any number gives a valid bound; heuristic
MIN_PIVOT = 1e-3  # [1] of a factor, so that rounding errors of bounds stay far below LOSS_ROUNDING; heuristic
HEIGHT_MARGIN = 1e-4  # [T_i] by which the first heights exceed T_i, so that M is clearly positive definite; heuristic
ASCENT_STEPS = 10  # [steps] of the heights at the first level; one at each later level; heuristic
STEP_SHARES = (1.0, 0.3, 0.1)  # [full step] tried in turn until the mean bound rises; heuristic
LOSS_ROUNDING = 1e-11  # [total energy] losses that differ by less count as equal; heuristic


def cone_inequalities(task: Task, observed: Observations, seed: int = 0) -> Array:
    """Rows c (g, b) with c'theta >= 0 for the base parameters theta of every real robot [1 over units of base].

    Three kinds: kinetic energy x'M(q)x >= 0 at observed configurations, for each joint's velocity alone and for random
    ones; law coefficients that are not negative; and |offset| <= 2 Coulomb friction where a joint has both, since
    friction alone fits as well as an offset of its size with signs that are all equal.
    """
    labels = [task.base.labels[k] for k in task.base.independent]
    positive = np.eye(task.base.rank)[[k for k in law_coefficients(task) if labels[k].positive]]
    rng, n = np.random.default_rng(seed), len(observed.joints)
    rms = observed.rms
    size = np.where(rms > 0, 1 / np.sqrt(np.where(rms > 0, rms, 1.0)), 0.0)  # similar kinetic energy of all joints
    at = np.sort(rng.choice(len(observed), min(KINETIC_POSES, len(observed)), replace=False))
    single, mixed = np.tile(np.diag(size), (len(at), 1)), rng.standard_normal((len(at) * KINETIC_VELOCITIES, n)) * size
    q = np.concatenate([observed.q[at].repeat(n, axis=0), observed.q[at].repeat(KINETIC_VELOCITIES, axis=0)])
    places = {law: k for k, law in law_coefficients(task).items()}
    unit, offsets = np.eye(task.base.rank), [np.zeros((0, task.base.rank))]
    for (name, joint), k in places.items():
        coulomb = places.get(("coulomb_friction", joint))
        if name == "torque_offset" and coulomb is not None:
            offsets.append(OFFSET_LIMIT * unit[coulomb] + np.array([[1.0], [-1.0]]) * unit[k])
    return np.concatenate([kinetic_rows(task, q, np.concatenate([single, mixed])), positive, *offsets])


def kinetic_rows(task: Task, q: Array, x: Array) -> Array:
    """Rows (k, b) whose product with theta is x'M(q)x = x'(torque(q, 0, x) - torque(q, 0, 0)).

    The third argument of the torque is the acceleration, here set to the velocities x (k, n) [rad/s or m/s], 0 at
    joints whose torque is unknown. The configurations are q (k, n) [rad or m].
    """
    n = len(task.robot.joints)
    t, still = np.arange(len(q), dtype=np.float64), np.zeros_like(q)
    motions = (Motion(task.robot, t, q, still, a, slow=task.slow) for a in (still, x))
    at_rest, pushed = (base_rows(motion, task.laws, task.wanted) for motion in motions)
    rows = np.zeros((len(q), task.base.rank))
    for j in range(n):
        rows[:, task.seen(j)] += x[:, j, None] * (pushed[j] - at_rest[j])
    return rows


@dataclass(frozen=True, eq=False)
class PhysicalCone(Frozen):
    """Coordinates z of a problem that a real robot can have: G z >= 0."""

    rows: Array  # (g, r) G, each row of length 1 [1]

    @classmethod
    def of(cls, problem: SignProblem, rows: Array) -> PhysicalCone:
        """Cone in the coordinates of a problem, by rows (g, b) [1 over units of base] on identifiable parameters."""
        size = np.linalg.norm(problem.back, axis=1)  # 0: unidentifiable
        rows = rows[~np.any((rows != 0) & (size == 0), axis=1)]
        moved = rows @ problem.back
        length = np.linalg.norm(moved, axis=1)
        kept = length > ZERO_ROW_LENGTH * (np.abs(rows) @ size)
        unit = moved[kept] / length[kept, None]
        distinct = np.unique(np.round(unit, 9), axis=0, return_index=True)[1]
        return cls(unit[np.sort(distinct)])

    def distance(self, z: Array) -> tuple[float, Array]:
        """Squared distance from the cone of z (r,) [standard deviations], and the point of the cone nearest to z (r,).

        Only violated rows enter, as few are active. If their multipliers cannot be computed, the result is a lower
        bound on the distance and a point outside the cone.

        Source: the dual, non-negative least squares: Lawson, Hanson, Solving Least Squares Problems, 1974, chapter 23.
        """
        least = CONE_TOLERANCE * float(np.linalg.norm(z))
        near, active = z, np.zeros(len(self.rows), dtype=bool)
        for _ in range(len(self.rows)):
            violated = (self.rows @ near < -least) & ~active
            if not violated.any():
                break
            active |= violated
            near = z + self.rows[active].T @ _multipliers(self.rows[active], z)
        return float(np.sum((near - z) ** 2)), near


def _multipliers(rows: Array, z: Array) -> Array:
    """Multipliers lam >= 0 such that z + rows' lam is the point nearest to z in the cone of these rows.

    If the solver fails, any lam >= 0 scaled to maximise the dual -|rows' lam|^2 - 2 lam'rows z gives a lower bound.
    """
    from scipy.optimize import lsq_linear, nnls

    try:
        return np.asarray(nnls(rows.T, -z, maxiter=BVLS_ROUNDS * len(rows))[0])
    except RuntimeError:  # too many iterations
        found = np.maximum(lsq_linear(rows.T, -z, (0, np.inf), method="bvls", max_iter=BVLS_ROUNDS * len(rows)).x, 0.0)
    step = rows.T @ found
    return np.asarray(found * max(-float(step @ z), 0.0) / max(float(step @ step), 1e-300))


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
        spent = tree.nodes >= budget.nodes or time_is_up(SIGN_SEARCH)
        tree.grow(min(SPENT_WIDTH, budget.width) if spent else budget.width)
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
        outside = self._outside(sums, cuts)
        return np.asarray(energy - self.heights.sum() - np.einsum("rw,rw->w", outside, outside))

    def solve(self, sums: Array, cuts: Array) -> Array:
        """(r, W) minimisers z of the lower bounds."""
        from scipy.linalg import solve_triangular

        outside = self._outside(sums, cuts)
        return np.asarray(solve_triangular(self.factor, outside, trans="T", lower=True, check_finite=False))

    def _outside(self, sums: Array, cuts: Array) -> Array:
        """(r, W) half-solved sums less planes @ prices; a few sweeps over prices >= 0 make them short."""
        outside, planes = self._half(sums.T), self._half(cuts)
        gram, inner = planes.T @ planes, planes.T @ outside
        prices = np.zeros(inner.shape)
        for _ in range(CUT_SWEEPS):
            for k, row in enumerate(gram):
                prices[k] = np.maximum(prices[k] + (inner[k] - row @ prices) / row[k], 0.0)
        outside -= planes @ prices
        return outside

    def _half(self, columns: Array) -> Array:
        if not columns.size:
            return np.zeros(columns.shape)
        from scipy.linalg import solve_triangular

        return np.asarray(solve_triangular(self.factor, columns, lower=True, check_finite=False))


class _Tree:
    """Nodes of the current level, and their ancestors."""

    def __init__(self, problem: SignProblem, cuts: Array, z: Array, below: float) -> None:
        # a known segment first, then descending |b_i|^3 / |b_i'z|: |b_i| is the influence of a sign, |b_i| / |b_i'z|
        # its uncertainty near z; the late segments have large |b_i'z|, where the relaxation is tight
        size = np.linalg.norm(problem.projections, axis=0)
        clear = np.abs(problem.projections.T @ z)
        score = size**3 / np.maximum(clear, 1e-12 * np.max(size, initial=1e-300) ** 2)
        if problem.anchored:
            score[-1] = np.inf
        self.order = np.argsort(-score, kind="stable")
        self.cuts = cuts
        self.energy = float(problem.energies.sum())
        self.below = below - LOSS_ROUNDING * self.energy
        self.one_sided = problem.anchored or not cuts.shape[1]  # the first segment has sign +1 only
        self.b = problem.projections[:, self.order]
        self.least = 1e-16 * max(self.energy, 1e-280)
        self.high = (1 + HEIGHT_MARGIN) * problem.energies[self.order] + self.least
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
        floors = np.empty((len(self.sums), len(self.order)))
        at = np.arange(len(self.sums))
        for i, (parent, signs) in zip(self.order[: self.level][::-1], self.ancestors[::-1], strict=True):
            floors[:, i] = signs[at]
            at = parent[at]
        return floors

    def _fitted(self, sums: Array) -> _Relaxed:
        """Parabolas after an ascent of the mean bound over some nodes."""
        later = self.b[:, self.level :]
        nodes = sums[np.unique(np.linspace(0, len(sums) - 1, PARABOLA_NODES).astype(int))]
        best = _relax(later, self.heights[self.level :]) or _relax(later, self.high[self.level :])
        assert best is not None, "parabolas as high as the energies leave M positive definite"
        value = float(best.floors(self.energy, nodes, self.cuts).mean())
        for _ in range(ASCENT_STEPS if self.level == 1 else 1):
            step = np.sqrt(np.mean((later.T @ best.solve(nodes, self.cuts)) ** 2, 1)) - best.heights
            for share in STEP_SHARES:
                trial = _relax(later, np.maximum(best.heights + share * step, self.least))
                reached = -np.inf if trial is None else float(trial.floors(self.energy, nodes, self.cuts).mean())
                if trial is not None and reached > value:
                    best, value = trial, reached
                    break
            else:
                break
        self.heights[self.level :] = best.heights
        return best


def _relax(later: Array, heights: Array) -> _Relaxed | None:
    """Parabolas of these heights (n,); None if M is not clearly positive definite."""
    from scipy.linalg import LinAlgError, cholesky  # imported here, since it takes long and signs are rarely needed

    scaled = later / np.sqrt(heights)
    try:
        factor = cholesky(np.eye(len(later)) - scaled @ scaled.T, lower=True, check_finite=False)
    except LinAlgError:
        return None
    return _Relaxed(heights, factor) if np.diag(factor).min(initial=1.0) > MIN_PIVOT else None
