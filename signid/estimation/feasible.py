"""Feasible standard parameters nearest to an estimate, in coordinates in which the prior is the identity.

The minimiser is found by Newton's method along the central path, or by an interior-point solver. Symmetric 4x4 matrices
are packed as ten coordinates with the same norm (Frobenius).
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..deadline import seconds_left, time_is_up
from ..regression.projection import least_squares
from ..types import Array, BaseMap, Estimate, Frozen, Indices, Mask, Parameters, pseudo_inertia

MIN_BODY_MASS = 1e-3  # [kg] mass below which a body counts as massless
MIN_BODY_RADIUS = 3e-3  # [m] radius of gyration below which a body counts as flat
SUBSTITUTE_MASS, SUBSTITUTE_RADIUS = 0.05, 0.03  # [kg], [m] mass and radius of gyration of a substitute
_BODY_SCALES = np.array([0.3] + [0.1] * 3 + [0.01] * 6)  # [1, m, m2] scale of a body's parameters per kg: 30 %, 10 cm
_MIN_INFORMATION = 1e-12  # [1] smallest information of an identifiable direction, over the largest
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
    return np.asarray((packed.reshape(-1, 10) @ BASIS.reshape(10, 16)).reshape(-1, 4, 4))


def congruence(factor: Array) -> Array:
    """Matrices (n, 10, 10) of the maps S -> factor S factor' between packed matrices, factor (n, 4, 4) [any]."""
    flat = BASIS.reshape(10, 16)
    kronecker = np.einsum("nik,njl->nijkl", factor, factor).reshape(-1, 16, 16)
    return np.asarray(flat @ kronecker @ flat.T)


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
    made = np.array([_feasible_body(body) for body in given]).reshape(-1, 10)
    fault = ("is thinner than 3 mm or infeasible", "has no mass")
    notes = tuple(
        f"body {i + 1} of the description {fault[int(old[0] < MIN_BODY_MASS)]}; "
        f"one of {new[0]:.3g} kg and {SUBSTITUTE_RADIUS * 100:.0f} cm radius of gyration replaces it"
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


def _feasible_body(body: Array) -> Array:
    """The body if it is feasible, else a similar feasible one."""
    matrix = pseudo_inertia(body)
    mass = matrix[3, 3] if matrix[3, 3] >= MIN_BODY_MASS else SUBSTITUTE_MASS
    centre = matrix[:3, 3] / mass
    spread, axes = np.linalg.eigh(matrix[:3, :3] - mass * np.outer(centre, centre))
    if mass == matrix[3, 3] and spread[0] >= MIN_BODY_RADIUS**2 * mass:
        return body
    spread = np.where(spread < MIN_BODY_RADIUS**2 * mass, SUBSTITUTE_RADIUS**2 * mass, spread)
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
    size[inertial(start)] = np.outer(start.bodies()[:, 0], _BODY_SCALES).ravel()
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
        one, two = self.bounds
        return [unpack(u[:one]), u[one:two], u[two:]]

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


def build_feasible(base: BaseMap, estimate: Estimate, prior: Parameters, weight: float) -> FeasibleProblem:
    """Problem over all ten parameters of each body, and each coefficient, that the torque depends on.

    The prior is strictly feasible; its weight is in squared standard deviations.
    """
    shown = np.abs(base.combination).max(0, initial=0.0) > 0
    body, bounded = inertial(prior), positive(prior)
    whole, rest = np.repeat(shown[body].reshape(-1, 10).any(1), 10), shown & ~body
    groups = [np.flatnonzero(body)[whole], np.flatnonzero(rest & bounded), np.flatnonzero(rest & ~bounded)]
    seen, bounds = np.concatenate(groups), (len(groups[0]), len(groups[0]) + len(groups[1]))
    stated = prior.values[seen]
    size = coefficient_sizes(base, estimate.value, prior.values, estimate.std)[seen]
    must = slice(*bounds)
    size[must] = np.where(stated[must] > 0, stated[must], size[must])
    bodies = np.array([pseudo_inertia(x) for x in stated[: bounds[0]].reshape(-1, 10)]).reshape(-1, 4, 4)
    transform = np.diag(np.r_[np.zeros(bounds[0]), size[bounds[0] :]])
    maps = TO_INERTIAL @ congruence(np.asarray(np.linalg.cholesky(bodies)))
    for i, block in zip(range(0, bounds[0], 10), maps, strict=True):
        transform[i : i + 10, i : i + 10] = block
    offset = np.r_[np.zeros(bounds[1]), stated[bounds[1] :]]
    root, columns = information_root(estimate.information), base.combination[:, seen]
    target = root @ (estimate.value - columns @ offset)
    return FeasibleProblem(root @ columns @ transform, target, weight, bounds, transform, offset, seen, prior)


def information_root(information: Array) -> Array:
    """Matrix R (r, b) with R'R = information (b, b) [inverse squared units], without unidentifiable directions."""
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    unit = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(unit, unit))
    identifiable = values > _MIN_INFORMATION * values.max(initial=0.0)
    return np.asarray(np.sqrt(values[identifiable])[:, None] * vectors[:, identifiable].T * scale)


_ZERO_DISTANCE = 1e-3  # [standard deviations] distance from the estimate that counts as zero
_MAX_DISTANCE_RATIO = 0.7  # [1] largest remaining share of the distance after the prior's weight is divided by ten
_TRACE_MARGIN = 1e-9  # [1] margin of a pseudo-inertia over its trace: it stays feasible when written with nine digits
_MAX_SHARPNESS = 1e5  # [standard deviations per prior size] largest singular value that the interior-point solver gets
_WEIGHT_FACTOR = 25.0  # [1] factor between successive weights of the prior
_MAX_NEWTON_STEPS = 25  # largest number of Newton steps per weight
_FIT_NAME = "the fit of feasible inertials"
_ROUNDING = 1e-16  # [1] rounding error over the largest number
_MAX_DECREMENT = 1e-6  # [1] squared decrement at which a minimiser has converged


@dataclass(frozen=True, eq=False)
class ConsistentFit(Frozen):
    """Feasible standard parameters, and the changes of the base parameters that they need."""

    parameters: Parameters
    base_value: Array  # (b,) [unit of each] combination @ parameters
    chi2: float  # squared distance from the estimate, weighted by its information
    moves: Array  # (b,) [standard deviations of the estimate], 0 where that is infinite
    feasible_without_moving: bool  # whether the estimate itself is feasible and was kept
    notes: tuple[str, ...] = ()

    @property
    def moved(self) -> float:
        """Largest change of a base parameter [standard deviations]."""
        return float(np.abs(self.moves).max(initial=0.0))


def fit_consistent(
    base: BaseMap, estimate: Estimate, prior: Parameters, *, prior_weight: float = 1e-2
) -> ConsistentFit:
    """Fit feasible standard parameters to the estimate; the prior determines unidentifiable directions.

    Minimises ||R(K x - b)||^2 + prior_weight * sum of tr(P0^-1 P) - log det P over the pseudo-inertias P of the bodies
    that the torque depends on. R'R is the information; friction and armature are not negative. If the estimate is
    feasible, it is kept, and the prior only determines unidentifiable directions. Feasibility is verified by Cholesky
    factors, not by the solver's status; an infeasible solution is moved towards the prior until it is feasible.

    The prior is usually that of the robot description; its massless, flat and infeasible bodies are replaced, and the
    notes say so. Its weight is in squared standard deviations.

    Source: Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018 (problem); Lee, Wensing, Park, IEEE T-RO 36(1), 2020 (log det).
    """
    start, notes = feasible_prior(base, prior)
    problem = build_feasible(base, estimate, start, prior_weight)
    u, status = solve(problem)
    if status not in ("optimal", "optimal_inaccurate"):
        notes += (f"the conic solver ended with {status!r}; Newton's method solved the problem instead",)
    kept = _kept(problem, u)
    parameters, share = (kept, 0.0) if kept else _verified(problem.standard(u), start)
    if share:
        notes += (f"a share of {share:.0e} of the prior was mixed in to make the parameters feasible beyond rounding",)
    value = base.combination @ parameters.values
    away = value - estimate.value
    identifiable = np.isfinite(estimate.std) & (estimate.std > 0)
    moves = np.divide(away, estimate.std, out=np.zeros_like(away), where=identifiable)
    chi2 = max(float(away @ estimate.information @ away), 0.0)
    return ConsistentFit(parameters, value, chi2, moves, kept is not None, notes)


def _kept(problem: FeasibleProblem, u: Array) -> Parameters | None:
    """Feasible parameters that reproduce the estimate, if the minimiser converges to it for a vanishing prior."""
    near = _ZERO_DISTANCE + 1e-10 * float(np.linalg.norm(problem.target))
    for decade in range(1, 8):
        if problem.distance(u) < near:
            parameters = problem.standard(u)
            return parameters if parameters.is_feasible(_TRACE_MARGIN) else None
        closer = polish(replace(problem, weight=10.0**-decade * problem.weight), u, steps=25)
        if problem.distance(closer) > _MAX_DISTANCE_RATIO * problem.distance(u):
            return None
        u = closer
    return None


def _verified(parameters: Parameters, prior: Parameters) -> tuple[Parameters, float]:
    """Parameters with the smallest share of the prior, in quarter decades, that makes them feasible."""
    for share in (0.0, *10.0 ** np.linspace(-14, -0.25, 56)):
        mixed = replace(parameters, values=(1 - share) * parameters.values + share * prior.values)
        if mixed.is_feasible():
            return mixed, float(share)
    return prior, 1.0


def solve(problem: FeasibleProblem) -> tuple[Array, str]:
    """Minimiser (d,) and its status: "optimal", or the reason why the interior-point solver failed.

    Newton's method follows the central path from the prior, usually in less time than the import of the interior-point
    solver takes. If it loses the path, that solver is used. It works best if prior and misfit are of similar size; if
    it fails, it is used again with a heavier prior, and Newton's method continues from there.
    """
    heaviest = max(problem.distance(problem.start) ** 2 / problem.weight, 1.0)
    u = trace_path(problem, heaviest)
    if u is not None:
        return u, "optimal"
    for heavier in (1.0, 1e4, 1e8):
        u, status = _solve_interior(replace(problem, weight=heavier * problem.weight))
        if u is not None:
            return follow_path(problem, u, heavier), status
        if time_is_up(_FIT_NAME):
            break
    return follow_path(problem, problem.start, heaviest), status


def trace_path(problem: FeasibleProblem, heavier: float) -> Array | None:
    """Minimiser (d,) by the central path from the prior; None if the path is lost or time is up.

    The prior is nearly the minimiser if its weight is `heavier` times that of the problem.
    """
    u = problem.start
    for eased in _eased_problems(problem, heavier):
        u = polish(eased, u, steps=_MAX_NEWTON_STEPS, precision=0.1, exact=False)
        if time_is_up(_FIT_NAME):
            return None
    u = polish(problem, polish(problem, u, steps=_MAX_NEWTON_STEPS, exact=False))
    return u if _newton(problem, u)[1] < _MAX_DECREMENT else None


def follow_path(problem: FeasibleProblem, u: Array, heavier: float) -> Array:
    """Minimiser (d,) by Newton's method, while the weight of the prior decreases in small strides.

    The initial u (d,) [1] is near the minimiser for a weight `heavier` times that of the problem. Strides are small
    because Newton's method is slow near the boundary of the feasible set. They end early if the misfit is so large that
    a lighter prior could reduce it by a thousandth at most.
    """
    for eased in _eased_problems(problem, heavier):
        u = polish(eased, u, steps=100, precision=0.1)
        if eased.weight * len(u) < 1e-3 * problem.distance(u) ** 2:
            return u
    return polish(problem, u)


def _eased_problems(problem: FeasibleProblem, heavier: float) -> Iterator[FeasibleProblem]:
    """Problems with successively lighter priors."""
    for factor in _WEIGHT_FACTOR ** np.arange(np.log(heavier) / np.log(_WEIGHT_FACTOR), 0.0, -1.0):
        yield replace(problem, weight=factor * problem.weight)


def polish(problem: FeasibleProblem, u: Array, steps: int = 30, precision: float = 1e-9, exact: bool = True) -> Array:
    """Minimiser (d,) by Newton's method with step halving, from a strictly feasible u (d,) [1].

    The iteration ends when a step gains less than `precision`, a share of the weight.
    """
    cost = problem.cost(u)
    for _ in range(steps):
        step, decrement = _newton(problem, u, exact)
        if decrement * problem.weight < _ROUNDING * cost:
            return u
        trials = (u + step * 0.5**k for k in range(30))
        better = next(((x, trial) for trial in trials if (x := problem.cost(trial)) < cost), None)
        if better is None:
            return u
        gain, (cost, u) = cost - better[0], better
        if gain < precision * problem.weight:
            return u
    return u


def _newton(problem: FeasibleProblem, u: Array, exact: bool = True) -> tuple[Array, float]:
    """Newton step (d,), and the squared decrement: about twice the remaining gain, as a share of the weight."""
    # In coordinates in which the Hessian of the prior's penalty is the identity, the step is a ridge regression.
    bodies, sizes, rest = problem.parts(u)
    factors = np.asarray(np.linalg.cholesky(bodies), dtype=np.float64)
    metric, (n, one), others = congruence(factors), (len(bodies), 10 * len(bodies)), np.r_[sizes, np.ones(len(rest))]
    wish = np.r_[(IDENTITY - pack(np.swapaxes(factors, 1, 2) @ factors)).ravel(), 1 - sizes, -rest]
    blocks = problem.matrix[:, :one].reshape(-1, n, 10).swapaxes(0, 1) @ metric
    matrix = np.hstack([blocks.swapaxes(0, 1).reshape(-1, one), problem.matrix[:, one:] * others])
    off = problem.target - problem.matrix @ u
    gap = off - matrix @ wish
    if exact:
        basis, factor = np.linalg.qr(np.vstack([matrix.T, (problem.weight / 2) ** 0.5 * np.eye(len(gap))]))
        further = basis[: len(u)] @ np.linalg.solve(factor.T, gap)
    else:  # normal equations are several times faster and less accurate
        normal = matrix @ matrix.T + problem.weight / 2 * np.eye(len(gap))
        further = matrix.T @ np.linalg.solve(normal, gap)
    step = wish + further
    whole = np.r_[(metric @ step[:one].reshape(n, 10, 1)).ravel(), others * step[one:]]
    return whole, float(2 * off @ (matrix @ step) / problem.weight + wish @ step)


def _solve_interior(problem: FeasibleProblem) -> tuple[Array | None, str]:
    import cvxpy as cp  # its import takes longer than the solution by Newton's method

    unit = problem.weight**0.5  # [standard deviations] unit of residuals
    left, sharpness, right = np.linalg.svd(problem.matrix / unit, full_matrices=False)
    eased = np.minimum(1.0, _MAX_SHARPNESS / np.maximum(sharpness, 1e-300))
    u = cp.Variable(len(problem.offset))
    rows = (eased * sharpness)[:, None] * right @ u - eased * (left.T @ problem.target) / unit
    (one, two), spread = problem.bounds, BASIS.reshape(10, 16).T
    bodies = [cp.reshape(spread @ u[i : i + 10], (4, 4), order="C") for i in range(0, one, 10)]
    barrier = sum((cp.trace(s) - cp.log_det(s) for s in bodies), cp.sum_squares(u[two:]) / 2)
    barrier += cp.sum(u[one:two] - cp.log(u[one:two]))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            program = cp.Problem(cp.Minimize(cp.sum_squares(rows) + barrier))
            program.solve(solver=cp.CLARABEL, time_limit=seconds_left())
    except cp.error.SolverError:
        return None, "failed"
    if u.value is None or not np.isfinite(problem.cost(u.value)):
        return None, f"{program.status} without a feasible point"
    return u.value, str(program.status)
