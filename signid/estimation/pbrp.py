"""Penalty-based retrieval of standard parameters: global search in a box with growing penalties on infeasibility.

This is the classical method (`signid identify --method pbrp`). The default, a convex fit, is in
`signid.estimation.feasible`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..deadline import show_step, time_is_up
from ..errors import OptionError
from ..optimisers import OPTIMISERS, Optimum, Problem
from ..toml_json import read_toml
from ..types import Array, BaseMap, Estimate, Frozen, Indices, Label, Parameters, pseudo_inertia
from .feasible import TO_INERTIAL, coefficient_sizes, feasible_prior, inertial, information_root, pack, positive

_MASS_RATIOS = (0.2, 3.0)  # [1] smallest and largest mass over that of the description
_MAX_BOUND = 1e100  # largest number in a bounds file
_MAX_CENTRE_SHIFT = 0.05  # [m] largest shift of a centre of mass, or twice the radius of gyration if that is larger
_QUANTITY_ROWS = {"mass": slice(0, 1), "first_moment": slice(1, 4), "inertia": slice(4, 10)}
PBRP_NAME = "the search for standard parameters"
_MAX_COST = 1e3  # [squared standard deviations] cost above which a search that stopped early is repeated
_MARGIN = 1e-3  # [1] margin of each constraint over its size, so that parameters without penalty are feasible
_MOMENTS = np.array([pseudo_inertia(e)[:3, :3] for e in np.eye(10)])  # (10, 3, 3) of second moments
_FLAT_MOMENTS = _MOMENTS.reshape(10, 9)
_MAX_BOX_SHARPNESS = 1e4  # [standard deviations per width of the box] largest sharpness that the search resolves
_MAX_BOX_GAIN = 1e-2  # [squared standard deviations] predicted gain over the whole box at which a run has converged
_EXTRA_ROUNDS = 6  # largest number of additional rounds, while the result is infeasible or has not converged
_LOCAL_BUDGET = 2_000  # evaluations of a local algorithm
_LOCAL_BUDGETS = {"LN_SBPLX": 10_000, "LN_NELDERMEAD": 10_000}  # the same for algorithms that take many small steps


@dataclass(frozen=True, eq=False)
class Bounds(Frozen):
    """Smallest and largest values of the p standard parameters."""

    lower: Array  # (p,) [unit of each]
    upper: Array  # (p,) [unit of each]

    def __post_init__(self) -> None:
        """Copy and check the arrays."""
        super().__post_init__()
        if self.lower.shape != self.upper.shape or not np.isfinite([self.lower, self.upper]).all():
            raise ValueError("the bounds are not two vectors of equal length of finite numbers; give such vectors")
        if (self.lower > self.upper).any():
            i = int(np.argmax(self.lower > self.upper))
            raise ValueError(
                f"lower bound {i} is {self.lower[i]:g}, above the upper bound {self.upper[i]:g}; swap them"
            )


def bounds_around(base: BaseMap, estimate: Estimate, prior: Parameters) -> Bounds:
    """Box around the description: 0.2 to 3 times each mass, centres near those of the description, matching inertias.

    The bounds of a coefficient are three times its size in `coefficient_sizes`.
    """
    start, _ = feasible_prior(base, prior)
    reach = 3 * coefficient_sizes(base, estimate.value, start.values, estimate.std)
    lower, upper = np.where(positive(start), 0.0, -reach), reach
    body = inertial(start)
    boxes = np.array([_body_box(x) for x in start.bodies()]).reshape(-1, 2, 10)
    lower[body], upper[body] = boxes[:, 0].ravel(), boxes[:, 1].ravel()
    return Bounds(lower, upper)


def check_box(box: Bounds, base: BaseMap) -> None:
    """Check that a box has the standard parameters of a base map.

    Raises:
        OptionError: their numbers differ.
    """
    if len(box.lower) != len(base.labels):
        raise OptionError(
            f"the bounds have {len(box.lower)} parameters; give the {len(base.labels)} standard parameters of the robot"
        )


def read_bounds(path: str | Path, links: Sequence[str], default: Bounds) -> Bounds:
    """Box from a TOML file; bounds that it does not state are those of the default.

    `[link.NAME]` holds any of `mass = [lo, hi]` [kg], `first_moment = [[lo, hi], [lo, hi], [lo, hi]]` [kg.m] and
    `inertia`, six pairs Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the link's joint frame [kg.m2]. The links are those of the
    bodies in the order of their parameters.

    Raises:
        OptionError: the file cannot be read, names an unknown link or quantity, or has an invalid interval.
    """
    try:
        content = read_toml(path)
    except (OSError, UnicodeDecodeError) as fault:
        raise OptionError(f"cannot read the bounds file {path}: {fault}") from None
    except ValueError as fault:
        raise OptionError(f"the bounds file {path} is not TOML: {fault}") from None
    sections = content.get("link", {})
    if set(content) - {"link"} or not isinstance(sections, dict):
        raise OptionError(f"the bounds file {path} has {', '.join(content)}; expected only tables [link.NAME]")
    lower, upper = default.lower.copy(), default.upper.copy()
    for link, quantities in sections.items():
        if link not in links:
            close = ", ".join(get_close_matches(link, links, n=3, cutoff=0.4) or links)
            raise OptionError(f"the bounds file {path} names {link!r}, which is not a moving link; choose from {close}")
        first = 10 * list(links).index(link)
        if not isinstance(quantities, Mapping):
            raise OptionError(f"link.{link} in {path} is {quantities!r}; expected a table [link.{link}]")
        for quantity, stated in quantities.items():
            where = f"{quantity} of [link.{link}] in {path}"
            low, high = _intervals(quantity, stated, where)
            rows = np.arange(first, first + 10)[_QUANTITY_ROWS[quantity]]
            lower[rows], upper[rows] = low, high
    return Bounds(lower, upper)


def _intervals(quantity: str, stated: Any, where: str) -> tuple[Array, Array]:
    """Lower and upper values of a quantity."""
    if quantity not in _QUANTITY_ROWS:
        raise OptionError(f"{where} is unknown; choose from {', '.join(_QUANTITY_ROWS)}")
    rows = range(10)[_QUANTITY_ROWS[quantity]]
    pairs = [stated] if quantity == "mass" else stated
    wanted = "a pair [lo, hi]" if quantity == "mass" else f"{len(rows)} pairs [lo, hi]"
    alike = isinstance(pairs, list) and len(pairs) == len(rows)
    lists = alike and all(isinstance(pair, list) and len(pair) == 2 for pair in pairs)
    if not lists or not all(type(x) in (int, float) and abs(x) < _MAX_BOUND for pair in pairs for x in pair):
        raise OptionError(f"{where} is {stated}; expected {wanted} of finite numbers")
    low, high = np.array(pairs, dtype=float).T
    if (low > high).any():
        raise OptionError(f"{where} is {stated}; expected each pair as [lo, hi] with lo <= hi")
    if quantity == "mass" and low[0] <= 0:
        raise OptionError(f"{where} is {stated}; expected masses above 0")
    return low, high


def _body_box(body: Array) -> Array:
    """Smallest and largest parameters (2, 10) around a feasible body."""
    matrix = pseudo_inertia(body)
    mass, centre = body[0], body[1:4] / body[0]
    spread = np.linalg.eigvalsh(matrix[:3, :3] - mass * np.outer(centre, centre))[-1] / mass  # [m2]
    near = max(_MAX_CENTRE_SHIFT, 2 * spread**0.5)
    masses = mass * np.array(_MASS_RATIOS)
    corners = np.multiply.outer(masses, centre + np.multiply.outer([-1, 1], np.full(3, near))).reshape(4, 3)
    far = np.abs(centre) + near + 2 * spread**0.5
    second = masses[1] * np.outer(far, far)
    largest = TO_INERTIAL @ pack(np.block([[second, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]]))
    reach = np.abs(largest[4:])
    diagonal = np.array([True, False, True, False, False, True])
    least = np.where(diagonal, 0.0, -reach)
    return np.array([[masses[0], *corners.min(0), *least], [masses[1], *corners.max(0), *reach]])


@dataclass(frozen=True, eq=False)
class Physics(Frozen):
    """Constraints of physics, each scaled by a size.

    Masses are positive. The inertia about each centre of mass is positive definite, and its principal moments satisfy
    the triangle inequality. Some coefficients are not negative. The total mass lies in a range.
    """

    bodies: Indices  # (nb, 10) indices of the inertial parameters
    positive: Indices  # (k,) indices of the coefficients that must not be negative
    mass: Array  # (nb,) [kg] sizes of the masses
    spread: Array  # (nb,) [kg.m2] sizes of the second moments about the centre of mass
    size: Array  # (k,) [unit of each] sizes of the coefficients
    total: tuple[float, float] | None = None  # [kg] range of the total mass

    def violation(self, x: Array) -> tuple[float, Array]:
        """Sum of the squared violations by x (p,) [unit of each], and its gradient (p,)."""
        slope = np.zeros_like(x)
        inertials = x[self.bodies]
        mass, d_mass = _squared_shortfall(inertials[:, 0] / self.mass - _MARGIN)
        coefficient, d_coefficient = _squared_shortfall(x[self.positive] / self.size)
        moments, d_moments = self._moments(inertials)
        total, d_total = self._total(inertials[:, 0].sum())
        slope[self.bodies] += d_moments
        slope[self.bodies[:, 0]] += d_mass / self.mass + d_total
        slope[self.positive] += d_coefficient / self.size
        return float(mass.sum() + coefficient.sum() + total + moments), slope

    def excess(self, x: Array) -> float:
        """Sum of the squared violations by x (p,) [unit of each], in less than half the time without the gradient."""
        inertials = x[self.bodies]
        mass, first = inertials[:, 0], inertials[:, 1:4]
        centre = first / np.maximum(mass, _MARGIN * self.mass)[:, None]
        second = np.reshape(inertials @ _FLAT_MOMENTS, (-1, 3, 3)) - first[:, :, None] * centre[:, None, :]
        values = np.linalg.eigvalsh(second) / self.spread[:, None]
        principal = values.sum(1)[:, None] - values
        short = [mass / self.mass - _MARGIN, values.ravel() - _MARGIN, principal.ravel() - _MARGIN]
        missing = np.minimum(np.concatenate([*short, x[self.positive] / self.size]), 0.0)
        return float(missing @ missing) + self._total(mass.sum())[0]

    def _moments(self, inertials: Array) -> tuple[float, Array]:
        """Violation of the second moments about the centres of mass, and its gradient (nb, 10)."""
        mass = np.maximum(inertials[:, 0], _MARGIN * self.mass)
        centre = inertials[:, 1:4] / mass[:, None]
        second = np.tensordot(inertials, _MOMENTS, 1) - mass[:, None, None] * centre[:, :, None] * centre[:, None, :]
        values, axes = np.linalg.eigh(second)  # eigenvalues >= 0: the triangle inequality of the principal moments
        triangle, d_triangle = _squared_shortfall(values / self.spread[:, None] - _MARGIN)
        principal, d_principal = _squared_shortfall((values.sum(1)[:, None] - values) / self.spread[:, None] - _MARGIN)
        by_value = (d_triangle + d_principal.sum(1)[:, None] - d_principal) / self.spread[:, None]
        weight = np.einsum("bik,bk,bjk->bij", axes, by_value, axes)
        slope = np.einsum("bij,kij->bk", weight, _MOMENTS)
        pull = np.einsum("bij,bj->bi", weight, centre)
        slope[:, 1:4] -= 2 * pull
        slope[:, 0] += np.where(inertials[:, 0] > _MARGIN * self.mass, np.einsum("bi,bi->b", pull, centre), 0.0)
        return float(triangle.sum() + principal.sum()), slope

    def _total(self, mass: float) -> tuple[float, float]:
        if self.total is None:
            return 0.0, 0.0
        size = float(self.mass.sum())
        over, under = max(mass - self.total[1], 0.0) / size, max(self.total[0] - mass, 0.0) / size
        return over**2 + under**2, 2 * (over - under) / size


def physics_of(
    base: BaseMap, estimate: Estimate, prior: Parameters, total: tuple[float, float] | None = None
) -> Physics:
    """Constraints of physics for a robot, with sizes from its description and, for coefficients, from an estimate.

    Raises:
        OptionError: the range [kg] of the total mass of all bodies is invalid.
    """
    if total is not None and not 0 <= total[0] <= total[1]:
        raise OptionError(f"total_mass is {total}; give (smallest, largest) in kg, not negative")
    start, _ = feasible_prior(base, prior)
    bodies = start.bodies()
    moments = np.array([pseudo_inertia(x)[:3, :3] - np.outer(x[1:4], x[1:4]) / x[0] for x in bodies]).reshape(-1, 3, 3)
    bounded = np.flatnonzero(positive(start) & ~inertial(start))
    return Physics(
        np.flatnonzero(inertial(start)).reshape(-1, 10),
        bounded,
        bodies[:, 0],
        np.linalg.eigvalsh(moments)[:, -1],
        coefficient_sizes(base, estimate.value, start.values, estimate.std)[bounded],
        total,
    )


def _squared_shortfall(value: Array) -> tuple[Array, Array]:
    """Square of the negative part, and its derivative."""
    missing = np.minimum(value, 0.0)
    return missing**2, 2 * missing


@dataclass(frozen=True, eq=False)
class PenaltyCost(Frozen):
    """Cost |matrix z - target|^2 + rest + weight * violation of physics, z (d,) in the unit cube.

    Free standard parameters are x = lower + (upper - lower) z; those with equal bounds are fixed.
    """

    matrix: Array  # (m, d) [standard deviations]
    target: Array  # (m,) [standard deviations]
    rest: float  # [squared standard deviations] part that no parameters explain
    free: Indices  # (d,) standard parameters of z
    box: Bounds
    physics: Physics

    @property
    def width(self) -> Array:
        """Width (d,) of the box [unit of each]."""
        return self.box.upper[self.free] - self.box.lower[self.free]

    def standard(self, z: Array) -> Array:
        """Standard parameters (p,) [unit of each] of z (d,) [1]."""
        x = self.box.lower.copy()
        x[self.free] += self.width * z
        return x

    def problem(self, z: Array, weight: float) -> Problem:
        """Optimisation problem that starts at z (d,) [1]; the violation has a weight [squared standard deviations]."""
        width, matrix, target = self.width, self.matrix, self.target

        def cost(z: Array) -> float:
            off = matrix @ z - target
            penalty = weight * self.physics.excess(self.standard(z)) if weight else 0.0
            return float(off @ off) + self.rest + penalty

        def gradient(z: Array) -> Array:
            slope = 2 * matrix.T @ (matrix @ z - target)
            if weight:
                slope += weight * width * self.physics.violation(self.standard(z))[1][self.free]
            return np.asarray(slope)

        return Problem(cost, np.zeros(len(z)), np.ones(len(z)), z, gradient, PBRP_NAME)


def cost_over(box: Bounds, physics: Physics, matrix: Array, target: Array, rest: float = 0.0) -> PenaltyCost:
    """Cost |matrix x - target|^2 + rest over the standard parameters x of a box.

    Here matrix is (m, p) [standard deviations per unit of each] and target (m,) [standard deviations].
    """
    free = np.flatnonzero(box.upper > box.lower)
    inside = matrix[:, free] * (box.upper - box.lower)[free]
    return PenaltyCost(inside, target - matrix @ box.lower, rest, free, box, physics)


def descend(cost: PenaltyCost, z: Array, weights: Iterable[float], algorithm: str, budget: int, seed: int) -> Optimum:
    """Rounds of one algorithm from z (d,) [1]; each has its own weight of the penalty and starts where the last ended.

    The budget is the number of evaluations per round.
    """
    found = Optimum(z, np.inf, "failed", 0, algorithm)
    for weight in weights:
        last = found.evaluations
        found = _minimise(cost.problem(found.x, weight), algorithm, budget, seed)
        found = replace(found, evaluations=last + found.evaluations)
    return found


def _minimise(problem: Problem, algorithm: str, budget: int, seed: int) -> Optimum:
    """Minimise, and once more in units of the cost reached if it is large: some algorithms stop early then."""
    search = OPTIMISERS["nlopt"].minimise
    found = search(problem, algorithm=algorithm, budget_evaluations=budget, seed=seed)
    left, size, slope = budget - found.evaluations, found.value, problem.gradient
    if left < 1 or slope is None or not _MAX_COST < size < np.inf:
        return found
    eased = replace(
        problem, objective=lambda z: problem.objective(z) / size, start=found.x, gradient=lambda z: slope(z) / size
    )
    again = search(eased, algorithm=algorithm, budget_evaluations=left, seed=seed)
    return replace(again, value=again.value * size, evaluations=found.evaluations + again.evaluations)


@dataclass(frozen=True)
class SearchRun:
    """Result of one start of the search."""

    cost: float  # chi2 with limited sharpness, plus the last penalty
    chi2: float  # squared distance from the estimate, weighted by its information
    violation: float  # violation of physics; 0 without any
    weight: float  # [squared standard deviations] weight of the last penalty
    feasible: bool  # by Cholesky factors of the pseudo-inertias
    converged: bool  # by the gradient
    evaluations: int


@dataclass(frozen=True, eq=False)
class Retrieval(Frozen):
    """Best run, and all runs."""

    parameters: Parameters
    best: SearchRun
    runs: tuple[SearchRun, ...]
    global_algorithm: str
    local_algorithm: str
    seed: int
    notes: tuple[str, ...] = ()


def retrieve(
    base: BaseMap,
    estimate: Estimate,
    prior: Parameters,
    bounds: Bounds | None = None,
    *,
    global_algorithm: str = "GN_CRS2_LM",
    local_algorithm: str = "LD_LBFGS",
    runs: int = 3,
    rounds: int = 10,
    schedule: float = 10.0,
    seed: int = 0,
    total_mass: tuple[float, float] | None = None,
    budget_global: int = 10_000,
    budget_local: int | None = None,
) -> Retrieval:
    """Search a box for standard parameters that reproduce the base parameters and obey physics.

    Each run starts at a random point of the box. Its first round fits only the base parameters, by a global and then a
    local algorithm. Each later round starts from the last one and adds a heavier penalty, `schedule` times its number,
    on violations of physics. Up to six rounds follow: with a tenfold penalty while the result is infeasible, with the
    same one while it has not converged. Algorithms with gradients (LD_) are suitable for up to 7 joints with friction,
    those without (LN_) for up to about 30 parameters. The search stays within its budget and notes how it ended.

    The prior gives only the sizes and the default box. The `schedule` is in squared standard deviations, the range of
    the total mass of all moving bodies in kg. Budgets are evaluations: of the global algorithm per run, of the local
    algorithm per round (default: 2 000, or 10 000 for those that take many small steps).

    Raises:
        OptionError: an algorithm does not exist, or runs, rounds, bounds or the range of mass are invalid.

    Source: Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca, IEEE RA-L 4(4), 2019, Algorithm 1.
    """
    if runs < 1 or rounds < 1:
        raise OptionError(f"runs is {runs} and rounds is {rounds}; give at least 1 of each")
    box = bounds_around(base, estimate, prior) if bounds is None else bounds
    cost = cost_of(base, estimate, box, physics_of(base, estimate, prior, total_mass))
    budget_local = budget_local or _LOCAL_BUDGETS.get(local_algorithm, _LOCAL_BUDGET)
    rng, found = np.random.default_rng(seed), list[_SearchResult]()
    for name in (global_algorithm, local_algorithm):
        OPTIMISERS["nlopt"].chosen(cost.problem(np.zeros(len(cost.free)), 0.0), name)
    weights = (schedule * np.arange(rounds)).tolist()
    for k in range(runs):
        show_step("searching standard parameters", k / runs)
        first = descend(cost, rng.uniform(size=len(cost.free)), [0.0], global_algorithm, budget_global, seed + k)
        show_step("searching standard parameters", (k + 1 / 3) / runs)
        ends = [first, descend(cost, first.x, weights, local_algorithm, budget_local, seed + k)]
        run = _judge_run(base, estimate, cost, weights[-1], ends)
        while not (run.feasible and run.converged) and len(ends) < 2 + _EXTRA_ROUNDS and not time_is_up(PBRP_NAME):
            weight = run.weight if run.feasible else 10 * max(run.weight, schedule)
            ends.append(descend(cost, ends[-1].x, [weight], local_algorithm, budget_local, seed + k))
            run = _judge_run(base, estimate, cost, weight, ends)
        found.append(_SearchResult(run, ends))
        if time_is_up(PBRP_NAME):
            break
    best = min(found, key=lambda f: (not f.run.feasible, f.run.cost))
    parameters = Parameters(base.labels, cost.standard(best.ends[-1].x))
    table, notes = tuple(f.run for f in found), _search_notes(best, cost, base.labels)
    return Retrieval(parameters, best.run, table, global_algorithm, local_algorithm, seed, notes)


class _SearchResult(NamedTuple):
    run: SearchRun
    ends: list[Optimum]  # of the global algorithm, of the regular rounds, of each additional round


def cost_of(base: BaseMap, estimate: Estimate, box: Bounds, physics: Physics) -> PenaltyCost:
    """Cost of a search: squared distance from an estimate with limited sharpness, plus the penalty."""
    check_box(box, base)
    root, width = information_root(estimate.information), box.upper - box.lower
    left, sharpness, right = np.linalg.svd(root @ base.combination * width, full_matrices=False)
    eased = np.minimum(1.0, _MAX_BOX_SHARPNESS / np.maximum(sharpness, 1e-300))
    rotated = (eased[:, None] * left.T) @ root
    return cost_over(box, physics, rotated @ base.combination, rotated @ estimate.value)


def _judge_run(base: BaseMap, estimate: Estimate, cost: PenaltyCost, weight: float, ends: list[Optimum]) -> SearchRun:
    """Result of a run, with feasibility and convergence tested independently of NLopt's status."""
    z = ends[-1].x
    x, last = cost.standard(z), cost.problem(z, weight)
    assert last.gradient is not None, "a cost has one"
    away, slope, value = base.combination @ x - estimate.value, last.gradient(z), last.objective(z)
    in_sight = float(np.max(np.abs(slope) * np.where(slope > 0, z, 1 - z), initial=0.0))
    return SearchRun(
        cost=value,
        chi2=max(float(away @ estimate.information @ away), 0.0),
        violation=cost.physics.excess(x),
        feasible=Parameters(base.labels, x).is_feasible(),
        weight=weight,
        converged=in_sight <= _MAX_BOX_GAIN + 1e-6 * value,
        evaluations=sum(end.evaluations for end in ends),
    )


def _search_notes(found: _SearchResult, cost: PenaltyCost, labels: tuple[Label, ...]) -> tuple[str, ...]:
    run, ends = found
    at_edge = (ends[-1].x == 1.0) | ((ends[-1].x == 0.0) & ~np.isin(cost.free, cost.physics.positive))
    edge = [labels[i].name for i in cost.free[at_edge]]
    failed = dict.fromkeys(end.algorithm for end in ends[: 1 if run.converged else None] if end.status == "failed")
    notes = [f"NLopt's {name} failed on this problem; the search continued from its last point" for name in failed]
    if not run.converged:
        spent = f"the search did not converge within {run.evaluations} evaluations"
        notes.append(f"{spent}; try another --local-algorithm, or --method convex")
    if not run.feasible:
        notes.append("the parameters are infeasible: the search found no feasible ones in the box; widen it")
    if edge:
        more = " ..." if len(edge) > 5 else ""
        notes.append(f"parameters at a bound of the box, which may be too narrow: {', '.join(edge[:5])}{more}")
    return tuple(notes)
