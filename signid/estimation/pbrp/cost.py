"""Box of standard parameters, and the cost in it: squared residual and penalties on violations of physics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import OptionError
from ...optimisers import OPTIMISERS, Optimum, Problem
from ...toml_json import read_toml
from ...types import Array, BaseMap, Estimate, Frozen, Indices, Parameters, pseudo_inertia
from ..feasible.fit import TO_INERTIAL, coefficient_sizes, feasible_prior, inertial, pack, positive

_MASS_RATIOS = (0.2, 3.0)  # [1] smallest and largest mass over that of the description
_MAX_BOUND = 1e100  # largest number in a bounds file
_MAX_CENTRE_SHIFT = 0.05  # [m] largest shift of a centre of mass, or twice the radius of gyration if that is larger
_QUANTITY_ROWS = {"mass": slice(0, 1), "first_moment": slice(1, 4), "inertia": slice(4, 10)}
PBRP_NAME = "the search for standard parameters"
_MAX_COST = 1e3  # [squared standard deviations] cost above which a search that stopped early is repeated
_MARGIN = 1e-3  # [1] margin of each constraint over its size, so that parameters without penalty are feasible
_MOMENTS = np.array([pseudo_inertia(e)[:3, :3] for e in np.eye(10)])  # (10, 3, 3) of second moments
_FLAT_MOMENTS = _MOMENTS.reshape(10, 9)


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
