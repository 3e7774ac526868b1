"""Convex problem of the feasible fit, in coordinates in which the prior is the identity."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...types import Array, BaseMap, Estimate, Frozen, Parameters, pseudo_inertia
from .packing import IDENTITY, TO_INERTIAL, congruence, diagonal, unpack
from .prior import coefficient_sizes, inertial, positive

_LOST = 1e-12  # [1] smallest information of an identifiable direction, over the largest


@dataclass(frozen=True, eq=False)
class FeasibleProblem(Frozen):
    """Minimisation of ||matrix u - target||^2 + weight * penalty(u) over feasible u.

    The vector u (d,) holds in this order, each part with its penalty:
    - ten coordinates of S for each of n bodies: tr S - log det S. The pseudo-inertia is C S C', its prior CC';
    - positive coefficients over their size: u - log u;
    - other coefficients, less their prior, over their size: u^2 / 2.
    """

    matrix: Array  # (r, d) [standard deviations]
    target: Array  # (r,) [standard deviations]
    weight: float  # [squared standard deviations] weight of the prior
    bounds: tuple[int, int]  # indices at which the positive and the other coefficients begin
    transform: Array  # (d, d) [unit of each] from u to the standard parameters `seen`
    offset: Array  # (d,) [unit of each]
    seen: NDArray[np.intp]  # (d,) standard parameters of u
    prior: Parameters

    def parts(self, u: Array) -> list[Array]:
        """Matrices S of the bodies (n, 4, 4), positive coefficients, other coefficients of u (d,) [1]."""
        bodies, *rest = np.split(u, self.bounds)
        return [unpack(bodies), *rest]

    @property
    def start(self) -> Array:
        """Point (d,) of the prior."""
        one, two = self.bounds
        rest = len(self.offset) - two
        return np.concatenate([np.tile(IDENTITY, one // 10), np.ones(two - one), np.zeros(rest)])

    def standard(self, u: Array) -> Parameters:
        """All standard parameters of u (d,) [1]; those that the torque does not depend on are the prior's."""
        values = self.prior.values.copy()
        values[self.seen] = self.transform @ u + self.offset
        return replace(self.prior, values=values)

    def distance(self, u: Array) -> float:
        """Distance of u (d,) [1] from the estimate [standard deviations]."""
        return float(np.linalg.norm(self.matrix @ u - self.target))

    def cost(self, u: Array) -> float:
        """Objective at u (d,) [1]; infinite for infeasible points."""
        bodies, sizes, rest = self.parts(u)
        if not np.isfinite(u).all() or (sizes <= 0).any():
            return np.inf
        try:
            factors = np.linalg.cholesky(bodies)
        except np.linalg.LinAlgError:
            return np.inf
        penalty = np.sum(factors**2) - 2 * np.sum(np.log(np.diagonal(factors, axis1=1, axis2=2)))
        penalty += np.sum(sizes - np.log(sizes)) + np.sum(rest**2) / 2
        return self.distance(u) ** 2 + self.weight * float(penalty)


def build_problem(base: BaseMap, estimate: Estimate, prior: Parameters, weight: float) -> FeasibleProblem:
    """Problem over all ten parameters of each body, and each coefficient, that the torque depends on.

    The prior is strictly feasible; its weight is in squared standard deviations.
    """
    groups = _seen(base, prior)
    seen, bounds = np.concatenate(groups), (len(groups[0]), len(groups[0]) + len(groups[1]))
    stated = prior.values[seen]
    size = coefficient_sizes(base, estimate.value, prior.values, estimate.std)[seen]
    must = slice(*bounds)
    size[must] = np.where(stated[must] > 0, stated[must], size[must])
    bodies = np.array([pseudo_inertia(x) for x in stated[: bounds[0]].reshape(-1, 10)]).reshape(-1, 4, 4)
    transform = diagonal(TO_INERTIAL @ congruence(np.asarray(np.linalg.cholesky(bodies))), size[bounds[0] :])
    offset = np.r_[np.zeros(bounds[1]), stated[bounds[1] :]]
    root, columns = information_root(estimate.information), base.combination[:, seen]
    target = root @ (estimate.value - columns @ offset)
    return FeasibleProblem(root @ columns @ transform, target, weight, bounds, transform, offset, seen, prior)


def information_root(information: Array) -> Array:
    """Matrix R (r, b) with R'R = information (b, b) [inverse squared units], without unidentifiable directions."""
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    unit = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(unit, unit))
    identifiable = values > _LOST * values.max(initial=0.0)
    return np.asarray(np.sqrt(values[identifiable])[:, None] * vectors[:, identifiable].T * scale)


def _seen(base: BaseMap, prior: Parameters) -> list[NDArray[np.intp]]:
    """Standard parameters that the torque depends on: all of a body's, positive coefficients, other coefficients."""
    shown = np.abs(base.combination).max(0, initial=0.0) > 0
    body, bounded = inertial(prior), positive(prior)
    whole = np.repeat(shown[body].reshape(-1, 10).any(1), 10)
    rest = shown & ~body
    return [np.flatnonzero(body)[whole], np.flatnonzero(rest & bounded), np.flatnonzero(rest & ~bounded)]
