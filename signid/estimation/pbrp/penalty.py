"""Violation of physics by standard parameters, and its gradient."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...errors import OptionError
from ...types import Array, BaseMap, Estimate, Frozen, Parameters, pseudo_inertia
from ..feasible.prior import coefficient_sizes, feasible_prior, inertial, positive

_MARGIN = 1e-3  # [1] margin of each constraint over its size, so that parameters without penalty are feasible
_SECOND = np.array([pseudo_inertia(e)[:3, :3] for e in np.eye(10)])  # (10, 3, 3) of second moments
_FLAT = _SECOND.reshape(10, 9)


@dataclass(frozen=True, eq=False)
class Physics(Frozen):
    """Constraints of physics, each scaled by a size.

    Masses are positive. The inertia about each centre of mass is positive definite, and its principal moments satisfy
    the triangle inequality. Some coefficients are not negative. The total mass lies in a range.
    """

    bodies: NDArray[np.intp]  # (nb, 10) indices of the inertial parameters
    positive: NDArray[np.intp]  # (k,) indices of the coefficients that must not be negative
    mass: Array  # (nb,) [kg] sizes of the masses
    spread: Array  # (nb,) [kg.m2] sizes of the second moments about the centre of mass
    size: Array  # (k,) [unit of each] sizes of the coefficients
    total: tuple[float, float] | None = None  # [kg] range of the total mass

    def violation(self, x: Array) -> tuple[float, Array]:
        """Sum of the squared violations, and its gradient (p,).

        Args:
            x: (p,) standard parameters [unit of each].
        """
        slope = np.zeros_like(x)
        inertials = x[self.bodies]
        mass, d_mass = _short(inertials[:, 0] / self.mass - _MARGIN)
        coefficient, d_coefficient = _short(x[self.positive] / self.size)
        moments, d_moments = self._moments(inertials)
        total, d_total = self._total(inertials[:, 0].sum())
        slope[self.bodies] += d_moments
        slope[self.bodies[:, 0]] += d_mass / self.mass + d_total
        slope[self.positive] += d_coefficient / self.size
        return float(mass.sum() + coefficient.sum() + total + moments), slope

    def excess(self, x: Array) -> float:
        """Sum of the squared violations without the gradient, in less than half the time.

        Args:
            x: (p,) standard parameters [unit of each].
        """
        inertials = x[self.bodies]
        mass, first = inertials[:, 0], inertials[:, 1:4]
        centre = first / np.maximum(mass, _MARGIN * self.mass)[:, None]
        second = np.reshape(inertials @ _FLAT, (-1, 3, 3)) - first[:, :, None] * centre[:, None, :]
        values = np.linalg.eigvalsh(second) / self.spread[:, None]
        principal = values.sum(1)[:, None] - values
        short = [mass / self.mass - _MARGIN, values.ravel() - _MARGIN, principal.ravel() - _MARGIN]
        missing = np.minimum(np.concatenate([*short, x[self.positive] / self.size]), 0.0)
        return float(missing @ missing) + self._total(mass.sum())[0]

    def _moments(self, inertials: Array) -> tuple[float, Array]:
        """Violation of the second moments about the centres of mass, and its gradient (nb, 10)."""
        mass = np.maximum(inertials[:, 0], _MARGIN * self.mass)
        centre = inertials[:, 1:4] / mass[:, None]
        second = np.tensordot(inertials, _SECOND, 1) - mass[:, None, None] * centre[:, :, None] * centre[:, None, :]
        values, axes = np.linalg.eigh(second)  # eigenvalues >= 0: the triangle inequality of the principal moments
        triangle, d_triangle = _short(values / self.spread[:, None] - _MARGIN)
        principal, d_principal = _short((values.sum(1)[:, None] - values) / self.spread[:, None] - _MARGIN)
        by_value = (d_triangle + d_principal.sum(1)[:, None] - d_principal) / self.spread[:, None]
        weight = np.einsum("bik,bk,bjk->bij", axes, by_value, axes)
        slope = np.einsum("bij,kij->bk", weight, _SECOND)
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
    """Constraints of physics for a robot, with sizes from its description.

    Args:
        base: base map.
        estimate: base parameters, for the sizes of the coefficients.
        prior: standard parameters of the description.
        total: smallest and largest sum of the masses of all bodies [kg].

    Raises:
        OptionError: the range of the total mass is invalid.
        ValueError: the prior does not have the labels of the base map.
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


def _short(value: Array) -> tuple[Array, Array]:
    """Square of the negative part, and its derivative."""
    missing = np.minimum(value, 0.0)
    return missing**2, 2 * missing
