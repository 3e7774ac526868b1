"""The convex problem behind the feasible fit, in coordinates in which the prior is the identity, and its solution."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ..deadline import seconds_left, time_is_up
from ..types import Array, BaseMap, Estimate, Frozen, Parameters, pseudo_inertia
from .packed import BASIS, IDENTITY, TO_INERTIAL, congruence, pack, unpack
from .prior import coefficient_sizes, inertial, positive

_LOST = 1e-12  # share of the largest information below which the recordings tell nothing
_SHARPEST = 1e5  # standard deviations per prior size that the interior-point solver is asked to resolve
_STRIDE = 5.0


@dataclass(frozen=True, eq=False)
class Cone(Frozen):
    """Minimise ||matrix u - target||^2 + weight * belief(u) over u inside the cone.

    u (d,) holds, in this order: ten coordinates of S for each of n bodies, P = C S C' the pseudo-inertia and CC' its
    prior, believed in by tr S - log det S; coefficients that must be positive in their own size, by u - log u; other
    coefficients from their prior in their own size, by u^2 / 2.
    """

    matrix: Array  # (r, d) [standard deviations]
    target: Array  # (r,) [standard deviations]
    weight: float  # of the prior, in squared standard deviations
    bounds: tuple[int, int]  # where the positive and where the other coefficients begin
    transform: Array  # (d, d) [unit of each] from u to the standard parameters seen
    offset: Array  # (d,) [unit of each]
    seen: NDArray[np.intp]  # (d,) the standard parameters that u stands for
    prior: Parameters

    def parts(self, u: Array) -> list[Array]:
        """S of the bodies (n, 4, 4), positive coefficients, other coefficients.

        Args:
            u: (d,) [1].
        """
        bodies, *rest = np.split(u, self.bounds)
        return [unpack(bodies), *rest]

    @property
    def start(self) -> Array:
        """(d,) the prior."""
        one, two = self.bounds
        rest = len(self.offset) - two
        return np.concatenate([np.tile(IDENTITY, one // 10), np.ones(two - one), np.zeros(rest)])

    def standard(self, u: Array) -> Parameters:
        """All standard parameters; those that no torque shows as in the prior.

        Args:
            u: (d,) [1].
        """
        values = self.prior.values.copy()
        values[self.seen] = self.transform @ u + self.offset
        return replace(self.prior, values=values)

    def distance(self, u: Array) -> float:
        """From the estimate, in standard deviations.

        Args:
            u: (d,) [1].
        """
        return float(np.linalg.norm(self.matrix @ u - self.target))

    def cost(self, u: Array) -> float:
        """What is minimised; infinite outside the cone.

        Args:
            u: (d,) [1].
        """
        bodies, sizes, rest = self.parts(u)
        if not np.isfinite(u).all() or (sizes <= 0).any():
            return np.inf
        try:
            factors = _cholesky(bodies)
        except np.linalg.LinAlgError:
            return np.inf
        belief = np.sum(factors**2) - 2 * np.sum(np.log(np.diagonal(factors, axis1=1, axis2=2)))
        belief += np.sum(sizes - np.log(sizes)) + np.sum(rest**2) / 2
        return self.distance(u) ** 2 + self.weight * float(belief)


def pose(base: BaseMap, estimate: Estimate, prior: Parameters, weight: float) -> Cone:
    """The problem over all of each body, and each coefficient, that torque shows.

    Args:
        base: which combinations of the standard parameters the torque shows.
        estimate: base parameters and their information.
        prior: strictly feasible.
        weight: of the prior [squared standard deviations].
    """
    groups = _seen(base, prior)
    seen, bounds = np.concatenate(groups), (len(groups[0]), len(groups[0]) + len(groups[1]))
    stated = prior.values[seen]
    size = coefficient_sizes(base, estimate.value, prior.values, estimate.std)[seen]
    must = slice(*bounds)
    size[must] = np.where(stated[must] > 0, stated[must], size[must])
    bodies = np.array([pseudo_inertia(x) for x in stated[: bounds[0]].reshape(-1, 10)])
    transform = _diagonal(TO_INERTIAL @ congruence(_cholesky(bodies)), size[bounds[0] :])
    offset = np.r_[np.zeros(bounds[1]), stated[bounds[1] :]]
    root, columns = information_root(estimate.information), base.combination[:, seen]
    target = root @ (estimate.value - columns @ offset)
    return Cone(root @ columns @ transform, target, weight, bounds, transform, offset, seen, prior)


def information_root(information: Array) -> Array:
    """(r, b) matrix R with R'R = information, without the directions that the recordings do not tell.

    Args:
        information: (b, b) [inverse squared units of the base parameters].
    """
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    unit = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(unit, unit))
    told = values > _LOST * values.max(initial=0.0)
    return np.asarray(np.sqrt(values[told])[:, None] * vectors[:, told].T * scale)


def solve(cone: Cone) -> tuple[Array, str]:
    """(d,) the minimiser, and what the interior-point solver said.

    That solver works best where prior and misfit are of one size: where it fails it is asked again with a heavier
    prior, and Newton's method follows the minimiser from there, or from the prior itself, to the weight asked for.
    """
    for heavier in (1.0, 1e4, 1e8):
        u, status = _ask(replace(cone, weight=heavier * cone.weight))
        if u is not None:
            return follow(cone, u, heavier), status
        if time_is_up("the fit of possible inertials"):
            break
    return follow(cone, cone.start, max(cone.distance(cone.start) ** 2 / cone.weight, 1.0)), status


def follow(cone: Cone, u: Array, heavier: float) -> Array:
    """(d,) the minimiser by Newton's method, in small strides from a prior so much heavier to the weight asked for.

    Strides are small because Newton's method alone creeps along the cone's surface once it has left the central path.
    They end early where the misfit is so large that no lighter prior could lessen it by more than a thousandth.

    Args:
        cone: the problem.
        u: (d,) near the minimiser for the heavier prior [1].
        heavier: factor on the weight.
    """
    for factor in _STRIDE ** np.arange(np.log(heavier) / np.log(_STRIDE), 0.0, -1.0):
        u = polish(replace(cone, weight=factor * cone.weight), u, steps=100, precision=0.1)
        if factor * cone.weight * len(u) < 1e-3 * cone.distance(u) ** 2:
            return u
    return polish(cone, u)


def polish(cone: Cone, u: Array, steps: int = 30, precision: float = 1e-9) -> Array:
    """(d,) the minimiser by Newton's method with halved steps, to the last digits that the information asks for.

    In the coordinates in which the Hessian of the belief is the identity each step is a ridge regression.

    Args:
        cone: the problem.
        u: (d,) a strictly feasible point [1].
        steps: at most so many.
        precision: a step that gains less than this share of the weight is the last.
    """
    cost = cone.cost(u)
    for _ in range(steps):
        bodies, sizes, rest = cone.parts(u)
        factors = _cholesky(bodies)
        metric = _diagonal(congruence(factors), np.r_[sizes, np.ones(len(rest))])
        wish = np.r_[(IDENTITY - pack(np.swapaxes(factors, 1, 2) @ factors)).ravel(), 1 - sizes, -rest]
        matrix = cone.matrix @ metric
        left, s, right = np.linalg.svd(matrix, full_matrices=False)
        gap = cone.target - cone.matrix @ u - matrix @ wish
        step = metric @ (wish + right.T @ (s / (s**2 + cone.weight / 2) * (left.T @ gap)))
        trials = (u + step * 0.5**k for k in range(30))
        better = next((trial for trial in trials if cone.cost(trial) < cost), None)
        if better is None:
            return u
        gain, u = cost - cone.cost(better), better
        cost -= gain
        if gain < precision * cone.weight:
            return u
    return u


def _ask(cone: Cone) -> tuple[Array | None, str]:
    import cvxpy as cp  # here, because it takes longer to import than to solve

    unit = cone.weight**0.5  # so many standard deviations count as one
    left, sharpness, right = np.linalg.svd(cone.matrix / unit, full_matrices=False)
    eased = np.minimum(1.0, _SHARPEST / np.maximum(sharpness, 1e-300))
    u = cp.Variable(len(cone.offset))
    rows = (eased * sharpness)[:, None] * right @ u - eased * (left.T @ cone.target) / unit
    (one, two), spread = cone.bounds, BASIS.reshape(10, 16).T
    bodies = [cp.reshape(spread @ u[i : i + 10], (4, 4), order="C") for i in range(0, one, 10)]
    belief = sum((cp.trace(s) - cp.log_det(s) for s in bodies), cp.sum_squares(u[two:]) / 2)
    belief += cp.sum(u[one:two] - cp.log(u[one:two]))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            problem = cp.Problem(cp.Minimize(cp.sum_squares(rows) + belief))
            problem.solve(solver=cp.CLARABEL, time_limit=seconds_left())
    except cp.error.SolverError:
        return None, "failed"
    if u.value is None or not np.isfinite(cone.cost(u.value)):
        return None, f"{problem.status} without a feasible point"
    return u.value, str(problem.status)


def _seen(base: BaseMap, prior: Parameters) -> list[NDArray[np.intp]]:
    """All of the bodies that torque shows, then the positive and then the other coefficients that it shows."""
    shown = np.abs(base.combination).max(0, initial=0.0) > 0
    body, bounded = inertial(prior), positive(prior)
    whole = np.repeat(shown[body].reshape(-1, 10).any(1), 10)
    rest = shown & ~body
    return [np.flatnonzero(body)[whole], np.flatnonzero(rest & bounded), np.flatnonzero(rest & ~bounded)]


def _diagonal(blocks: Array, rest: Array) -> Array:
    return np.asarray(scipy.linalg.block_diag(np.zeros((0, 0)), *blocks, np.diag(rest)))


def _cholesky(matrices: Array) -> Array:
    return np.asarray(np.linalg.cholesky(matrices.reshape(-1, 4, 4)), dtype=np.float64)
