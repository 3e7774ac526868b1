"""Cost of a motion: criterion and penalties on limits, with their gradient over a family of motions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...types import Array, Frozen
from .families import Family, column_sizes, combine
from .problem import ExcitationProblem

STEPS = np.array([1e-6, 1e-6, 1e-3])  # [rad, rad/s, rad/s2] steps of the regressor's numerical derivatives
REVERSAL = 0.03  # [1] speed over its limit below which the direction of friction is smoothed, for a gradient
FLOOR = 1e-13  # [1] smallest eigenvalue over the largest; smaller ones are zero up to rounding
SHARP = 4  # power of the power means that smooth the extreme eigenvalues

Criterion = Callable[[Array], tuple[float, Array]]
"""Information (b, b) [1] of scaled parameters -> cost to minimise, and its gradient (b, b)."""


def determinant(information: Array) -> tuple[float, Array]:
    """D-optimality of information (b, b) [1]: mean log of the principal standard deviations, and its gradient (b, b).

    Source: Swevers et al., IEEE T-RA 13(5), 1997, section III.
    """
    values, vectors = _spectrum(information)
    return float(-np.mean(np.log(values)) / 2), -(vectors / values) @ vectors.T / (2 * len(values))


def condition(information: Array) -> tuple[float, Array]:
    """Log of the regressor's condition number, from information (b, b) [1], with smoothed extremes; its gradient.

    Source: Gautier, Khalil, Int. J. Robotics Research 11(4), 1992; smoothed by power means of the eigenvalues.
    """
    values, vectors = _spectrum(information)
    large, small = (values / values[-1]) ** SHARP, (values[0] / values) ** SHARP
    top, low = large.sum(), small.sum()
    cost = (np.log(values[-1] / values[0]) + np.log(top * low) / SHARP) / 2
    slope = (large / top - small / low) / values / 2
    return float(cost), (vectors * slope) @ vectors.T


CRITERIA: dict[str, Criterion] = {"determinant": determinant, "condition": condition}


def _spectrum(information: Array) -> tuple[Array, Array]:
    values, vectors = np.linalg.eigh(information)
    return np.maximum(values, FLOOR * max(values[-1], 1e-300)), vectors


@dataclass(frozen=True, eq=False)
class ExcitationCost(Frozen):
    """Cost of a motion with scaled parameters z (n * d,) [1]: mean position relative to the middle, then the rest."""

    problem: ExcitationProblem
    criterion: Criterion
    family: Family
    t: Array  # (N,) [s] samples at which the cost is computed
    penalty: float  # [1] weight of the mean square relative excess over a limit
    spare: float  # [m] extra distance between links, beyond the clearance

    @cached_property
    def basis(self) -> Array:
        """Basis (3, N, d) [1, 1/s, 1/s2] at the samples."""
        return self.family.basis(self.t)

    @cached_property
    def sizes(self) -> Array:
        """Parameters (n, d) [rad or m] at z = 1."""
        sizes = column_sizes(self.basis, self.problem.limits)
        sizes[:, 0] = self.problem.limits.half
        return sizes

    def parameters(self, z: Array) -> Array:
        """Parameters (n, d) [rad or m] from z (n * d,) [1]."""
        x = z.reshape(self.sizes.shape) * self.sizes
        x[:, 0] += self.problem.limits.middle
        return x

    def relative(self, x: Array) -> Array:
        """Scaled parameters z (n * d,) [1] from x (n, d) [rad or m]."""
        y = x.copy()
        y[:, 0] -= self.problem.limits.middle
        return (y / self.sizes).ravel()

    def value(self, z: Array) -> float:
        """Cost of z (n * d,) [1]."""
        states = combine(self.basis, self.parameters(z))
        rows = self._rows(states)
        cost = self.criterion(self.problem.information(rows) / len(self.t))[0]
        return cost + self.penalty * (self._excess(states)[0] + self._overload(rows)[0] + self._contact(states)[0])

    def value_and_slope(self, z: Array) -> tuple[float, Array]:
        """Cost of z (n * d,) [1], and its gradient (n * d,) [1] by differences of the rows at every sample."""
        n, count = self.sizes.shape[0], len(self.t)
        states = combine(self.basis, self.parameters(z))
        near = np.repeat(states[:, None], 1 + 3 * n, axis=1)  # (3, 1 + 3 n, N, n)
        for k in range(3):
            for j in range(n):
                near[k, 1 + k * n + j, :, j] += STEPS[k]
        shifted = self._rows(near.reshape(3, -1, n))
        rows = [x[:count] for x in shifted]
        cost, slope = self.criterion(self.problem.information(rows) / count)
        excess, by_state = self._excess(states)
        overload, by_load = self._overload(rows)
        contact, by_place = self._contact(states)
        by_state = self.penalty * by_state
        by_state[0] += self.penalty * by_place
        for x, x0, seen, load in zip(shifted, rows, self.problem.base.sees, by_load, strict=True):
            weight = 2 / count * x0 @ slope[np.ix_(seen, seen)] + self.penalty * load
            each = x.reshape(-1, count, x.shape[1])
            moved = np.einsum("sim,im->si", each[1:] - each[0], weight)  # differences first: no rounding of the weight
            change = moved.reshape(3, n, count) / STEPS[:, None, None]
            by_state += change.transpose(0, 2, 1)
        by_parameter = np.einsum("kid,kij->jd", self.basis, by_state) * self.sizes
        return cost + self.penalty * (excess + overload + contact), by_parameter.ravel()

    def _rows(self, states: Array) -> list[Array]:
        """Rows of states (3, M, n), whose times repeat the samples."""
        t = np.resize(self.t, states.shape[1])
        return self.problem.rows(t, states[0], states[1], states[2], slow=REVERSAL * self.problem.limits.velocity)

    def _excess(self, states: Array) -> tuple[float, Array]:
        """Mean square excess over position, velocity and acceleration limits; gradient (3, N, n)."""
        limits = self.problem.limits
        share = limits.shares(*states)
        over = share - np.clip(share, -1, 1)
        return float(np.sum(over**2)) / len(self.t), 2 * over / limits.allowed[:, None] / len(self.t)

    def _overload(self, rows: Sequence[Array]) -> tuple[float, list[Array]]:
        """Mean square excess over torque limits; gradient (N, m_j) per joint."""
        total, slopes, problem = 0.0, [], self.problem
        for j, (x, seen) in enumerate(zip(rows, problem.base.sees, strict=True)):
            per_row = problem.value[seen] * problem.size[seen] * problem.noise[j]
            share = x @ per_row / (problem.limits.torque[j] * problem.limits.margin)
            over = share - np.clip(share, -1, 1)
            total += float(np.sum(over**2)) / len(self.t)
            scale = 2 / (problem.limits.torque[j] * problem.limits.margin) / len(self.t)
            slopes.append(np.outer(over * scale, per_row))
        return total, slopes

    def _contact(self, states: Array) -> tuple[float, Array]:
        """Mean square of the missing share of the clearance; gradient (N, n)."""
        if self.problem.collision is None:
            return 0.0, np.zeros(states.shape[1:])
        return self.problem.collision.penalty(states[0], self.problem.clearance, self.spare)
