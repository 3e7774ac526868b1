"""Convex problem of the feasible fit, in coordinates in which the prior is the identity.

Symmetric 4x4 matrices are packed as ten coordinates with the same norm (Frobenius).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...regression.projection import least_squares
from ...types import Array, BaseMap, Estimate, Frozen, Indices, Mask, Parameters, pseudo_inertia

LEAST_MASS = 1e-3  # [kg] mass below which a body counts as massless
LEAST_RADIUS = 3e-3  # [m] radius of gyration below which a body counts as flat
MASS, RADIUS = 0.05, 0.03  # [kg], [m] mass and radius of gyration of a substitute
_SCALE = np.array([0.3] + [0.1] * 3 + [0.01] * 6)  # [1, m, m2] scale of a body's parameters per kg: 30 %, 10 cm
_LOST = 1e-12  # [1] smallest information of an identifiable direction, over the largest
_PAIRS = np.tril_indices(4)
BASIS = np.zeros((10, 4, 4))
BASIS[np.arange(10), _PAIRS[0], _PAIRS[1]] = BASIS[np.arange(10), _PAIRS[1], _PAIRS[0]] = np.where(
    _PAIRS[0] == _PAIRS[1], 1.0, 0.5**0.5
)


def pack(matrix: Array) -> Array:
    """Coordinates (..., 10) of symmetric matrices: matrix (..., 4, 4) [any]."""
    return np.asarray(np.einsum("aij,...ij->...a", BASIS, matrix))


def unpack(packed: Array) -> Array:
    """Symmetric matrices (n, 4, 4) from ten coordinates each: packed (10 n,) or (n, 10) [any]."""
    return np.asarray(np.tensordot(packed.reshape(-1, 10), BASIS, 1))


def congruence(factor: Array) -> Array:
    """Matrices (n, 10, 10) of the maps S -> factor S factor' between packed matrices, factor (n, 4, 4) [any]."""
    flat = BASIS.reshape(10, 16)
    kronecker = np.einsum("nik,njl->nijkl", factor, factor).reshape(-1, 16, 16)
    return np.asarray(flat @ kronecker @ flat.T)


def diagonal(blocks: Array, rest: Array) -> Array:
    """Block-diagonal matrix (10 n + k, 10 n + k) of blocks (n, 10, 10) [any] and single entries rest (k,) [any]."""
    bodies = 10 * len(blocks)
    matrix = np.diag(np.concatenate([np.zeros(bodies), rest]))
    for i, block in zip(range(0, bodies, 10), blocks, strict=True):
        matrix[i : i + 10, i : i + 10] = block
    return matrix


TO_INERTIAL: Array = np.linalg.inv(np.column_stack([pack(pseudo_inertia(e)) for e in np.eye(10)]))
"""Map (10, 10) from a packed pseudo-inertia to ten inertial parameters in Pinocchio's order."""

IDENTITY = pack(np.eye(4))
"""Packed identity matrix (10,)."""


def inertial(parameters: Parameters) -> Mask:
    """Mask (p,) of the standard parameters that are inertial parameters of a body."""
    return np.array([label.body is not None for label in parameters.labels], dtype=bool)


def positive(parameters: Parameters) -> Mask:
    """Mask (p,) of the standard parameters with a lower bound of zero."""
    return np.array([label.positive for label in parameters.labels], dtype=bool)


def feasible_prior(base: BaseMap, prior: Parameters) -> tuple[Parameters, tuple[str, ...]]:
    """Strictly feasible prior: massless, flat and infeasible bodies are replaced, with a sentence on each; NaN is 0.

    Raises:
        ValueError: the prior does not have the labels of the base map.
    """
    if prior.labels != base.labels:
        raise ValueError(
            f"the {len(prior.labels)} labels of the prior differ from the {len(base.labels)} of the base map; "
            "build both from the same robot and the same laws"
        )
    values = np.nan_to_num(prior.values)
    values[positive(prior)] = np.maximum(values[positive(prior)], 0.0)
    given = values[inertial(prior)].reshape(-1, 10)
    made = np.array([_solid(body) for body in given]).reshape(-1, 10)
    fault = ("is thinner than 3 mm or infeasible", "has no mass")
    notes = tuple(
        f"body {i + 1} of the description {fault[int(old[0] < LEAST_MASS)]}; "
        f"one of {new[0]:.3g} kg and {RADIUS * 100:.0f} cm radius of gyration replaces it"
        for i, (old, new) in enumerate(zip(given, made, strict=True))
        if not np.array_equal(old, new)
    )
    values[inertial(prior)] = made.ravel()
    return replace(prior, values=values), notes


def coefficient_sizes(base: BaseMap, value: Array, prior: Array, std: Array | None = None) -> Array:
    """Scale (p,) of each parameter: its size if it alone made up the base parameters that it is part of.

    Base parameters: value (b,) [unit of each], their std (b,) [unit of each], inf where unidentifiable: ignored.
    The size is at least that of prior (p,) [unit of each].
    """
    known = np.abs(value) if std is None else np.where(np.isfinite(std), np.abs(value) + std, 0.0)
    share = np.abs(base.combination)
    alone = (known[:, None] / np.where(share > 0, share, np.inf)).max(0, initial=0.0)
    size = np.maximum(alone, np.abs(prior))
    return np.where(size > 0, size, 1.0)


def _solid(body: Array) -> Array:
    """The body if it is feasible, else a similar feasible one."""
    matrix = pseudo_inertia(body)
    mass = matrix[3, 3] if matrix[3, 3] >= LEAST_MASS else MASS
    centre = matrix[:3, 3] / mass
    spread, axes = np.linalg.eigh(matrix[:3, :3] - mass * np.outer(centre, centre))
    if mass == matrix[3, 3] and spread[0] >= LEAST_RADIUS**2 * mass:
        return body
    spread = np.where(spread < LEAST_RADIUS**2 * mass, RADIUS**2 * mass, spread)
    matrix[:3, :3] = (axes * spread) @ axes.T + mass * np.outer(centre, centre)
    matrix[3, 3] = mass
    return np.asarray(TO_INERTIAL @ pack(matrix))


def standard_from_base(base: BaseMap, value: Array, prior: Parameters) -> Parameters:
    """Standard parameters nearest to the prior that reproduce the base parameters exactly, feasible or not.

    Distances are measured in 30 % of a body's mass, 10 cm for its centre, (10 cm)^2 per kg for its inertia, and in the
    size of a coefficient. The base parameters are value (b,) [kg, kg.m, kg.m2 or the unit of the leading coefficient].
    """
    start, _ = feasible_prior(base, prior)
    size = coefficient_sizes(base, value, start.values)
    size[inertial(start)] = np.outer(start.bodies()[:, 0], _SCALE).ravel()
    x = np.nan_to_num(prior.values)
    for _ in range(3):  # the second and the third iteration remove rounding errors
        rest = value - base.combination @ x
        x = x + size * least_squares(base.combination * size, rest)
    return Parameters(prior.labels, x)


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
    seen: Indices  # (d,) standard parameters of u
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


def _seen(base: BaseMap, prior: Parameters) -> list[Indices]:
    """Standard parameters that the torque depends on: all of a body's, positive coefficients, other coefficients."""
    shown = np.abs(base.combination).max(0, initial=0.0) > 0
    body, bounded = inertial(prior), positive(prior)
    whole = np.repeat(shown[body].reshape(-1, 10).any(1), 10)
    rest = shown & ~body
    return [np.flatnonzero(body)[whole], np.flatnonzero(rest & bounded), np.flatnonzero(rest & ~bounded)]
