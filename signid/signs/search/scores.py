"""Losses of signs under a cone, and the half-spaces that they show."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ...types import Array
from .branch_and_bound import ROUNDING, bounds
from .problem import SignProblem

CUTS = 64  # half-spaces kept
WORTH = 0.9  # of a distance: a half-space is kept where those before it tell less


class ConvexCone(Protocol):
    """A convex cone of coordinates, such as a real robot could have."""

    def distance(self, z: Array) -> tuple[float, Array]:
        """Squared distance from the cone, and the nearest point of it (r,) [standard deviations].

        Where that cannot be computed, a lower bound of it, and a point outside.

        Args:
            z: (r,) [standard deviations].
        """
        ...


class WholeSpace:
    """The cone that leaves nothing out."""

    def distance(self, z: Array) -> tuple[float, Array]:
        """Nothing, and the point itself: (r,) [standard deviations].

        Args:
            z: (r,) [standard deviations].
        """
        return 0.0, z


class Scores:
    """J(s) plus the squared distance of B s from a cone, of all signs looked at so far.

    With p the point of the cone nearest to z, (z - p)'y <= 0 for every y in it: each distance computed shows a
    half-space that bounds the distances of other signs from below.

    Args:
        problem: the boolean least squares.
        cone: of coordinates.
        limit: [squared standard deviations] signs are scored that may lose less; None: those that may be the best.
        cuts: (r, C) [1] normals of half-spaces already known.
    """

    def __init__(
        self, problem: SignProblem, cone: ConvexCone, limit: float | None = None, cuts: Array | None = None
    ) -> None:
        self.problem, self.cone, self._limit = problem, cone, limit
        self.same = ROUNDING * float(problem.energies.sum())
        self.cuts = np.zeros((len(problem.projections), 0)) if cuts is None else cuts
        self.best, self.signs, self.coordinates = np.inf, np.zeros(0), np.zeros(0)
        self._seen: dict[bytes, float] = {}

    @property
    def limit(self) -> float:
        """Signs that cannot lose less are not scored [squared standard deviations]."""
        return (self.best if self._limit is None else self._limit) + self.same

    def add(self, signs: Array, most: int | None = None) -> float:
        """Score signs and their opposites, the most promising first, while they may be below the limit.

        Returns a lower bound of what those lose that may be below it and were left out, inf without any.

        Args:
            signs: (K, S) [1].
            most: distances computed, about.
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
        """Whether the coordinates of the best signs lie in the cone, so that their loss is no mere lower bound."""
        return self.cone.distance(self.coordinates)[0] <= self.same

    def ranked(self) -> tuple[Array, Array]:
        """All signs scored, (K, S) [1], and their losses (K,) [squared standard deviations], the best first."""
        losses = np.array(list(self._seen.values()))
        at = np.argsort(losses, kind="stable")
        signs = np.array([np.frombuffer(key, dtype=np.int8) for key in self._seen], dtype=float)
        return signs[at], losses[at]

    def _add(self, signs: Array) -> bool:
        """Score signs, unless they are known or cannot be below the limit."""
        key = signs.astype(np.int8).tobytes()
        if key in self._seen:
            return False
        loss = self.problem.loss(signs)
        told = float(bounds(self.problem, signs[None], self.cuts)[0]) - loss
        if loss + told >= self.limit:
            return False
        z = self.problem.coordinates(signs)
        squared, nearest = self.cone.distance(z)
        self._seen[key] = loss + squared
        if loss + squared < self.best:
            self.best, self.signs, self.coordinates = loss + squared, np.array(signs), nearest
        if squared > self.same and told < WORTH * squared and self.cuts.shape[1] < CUTS:
            self.cuts = np.column_stack([self.cuts, (z - nearest) / np.linalg.norm(z - nearest)])
        return True
