"""Losses of signs under a convex cone, and the half-spaces that bound other losses from below."""

from __future__ import annotations

import numpy as np

from ...types import Array
from .branch_and_bound import ROUNDING, bounds
from .cone import PhysicalCone
from .problem import SignProblem

CUTS = 64  # half-spaces kept, since each bound costs a sweep over them; heuristic
WORTH = 0.9  # [squared distance] a half-space is kept where those before it give a lower bound below; heuristic


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
        self.same = ROUNDING * float(problem.energies.sum())
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
        if squared > self.same and bound < WORTH * squared and self.cuts.shape[1] < CUTS:
            self.cuts = np.column_stack([self.cuts, (z - nearest) / np.linalg.norm(z - nearest)])
        return True
