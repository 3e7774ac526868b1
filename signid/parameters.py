"""Standard and base parameters, with their labels beside them.

Shapes: n joints that move by themselves, nb bodies, p standard parameters, b base parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arrays import Array, Frozen, Indices, Mask

INERTIAL = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")  # Pinocchio's order
INERTIAL_UNITS = ("kg", *("kg.m",) * 3, *("kg.m2",) * 6)
TWO_SIDED = 1.96  # standard deviations to either side that hold 95 % of a normal distribution


@dataclass(frozen=True)
class Label:
    """What one standard parameter is: an inertial parameter of a body, or a coefficient of a law."""

    name: str  # "Izz_2", "armature_1"
    unit: str
    body: int | None = None  # 0-based body of the model, for inertial parameters
    law: int | None = None  # index of the law it belongs to
    joint: int | None = None  # column of the joint that the law acts on
    positive: bool = False  # physics allows no negative value


@dataclass(frozen=True, eq=False)
class BaseMap(Frozen):
    """Which combinations of the standard parameters torque can show: base = combination @ standard."""

    labels: tuple[Label, ...]  # p
    independent: Indices  # (b,) the standard parameter that leads each combination
    combination: Array  # (b, p) [unit of base over unit of standard]
    expressions: tuple[str, ...]  # b formulas, "Izz_2 + 0.09 m_3"
    units: tuple[str, ...]  # b
    sees: Mask  # (n, b) whether the torque of a joint depends on a base parameter at all
    singular_values: Array  # (p,) [1] of the scaled regressor on random states, descending
    condition: float  # of the kept columns, scaled

    @property
    def rank(self) -> int:
        return len(self.independent)

    @property
    def invisible(self) -> tuple[Label, ...]:
        """Standard parameters that no motion can tell, not even in a combination."""
        seen = np.abs(self.combination).max(0, initial=0.0) > 0
        return tuple(label for label, s in zip(self.labels, seen, strict=True) if not s)


@dataclass(frozen=True, eq=False)
class Estimate(Frozen):
    """Base parameters as the recordings tell them, with what is known about their errors."""

    value: Array  # (b,) [units of base]
    covariance: Array  # (b, b) [units of base]; infinite variance where the recordings tell nothing
    information: Array  # (b, b) [1/units of base] Gram matrix weighted by the noise: what a deviation costs in torque
    noise: Array  # (n,) [N.m or N] standard deviation of the residual at the reduced rate
    orders: tuple[int, ...]  # (n,) order of the autoregressive noise model
    method: str = "weighted least squares"
    notes: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()  # why not to trust it

    @property
    def std(self) -> Array:
        """(b,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, eq=False)
class Parameters(Frozen):
    """Standard parameters: ten inertial parameters per body, then the coefficients of the laws."""

    labels: tuple[Label, ...]  # p
    values: Array  # (p,) [units of the labels]

    def bodies(self) -> Array:
        """(nb, 10) inertial parameters in Pinocchio's order [kg, kg.m, kg.m2]."""
        return self.values[[i for i, label in enumerate(self.labels) if label.body is not None]].reshape(-1, 10)

    def is_feasible(self, margin: float = 1e-12) -> bool:
        """Whether a real robot could have them: every pseudo-inertia positive definite, friction and armature >= 0.

        Proved by Cholesky factors of pseudo-inertia - margin * trace, not by any solver's word.

        Source: Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018.
        """
        positive = [value for label, value in zip(self.labels, self.values, strict=True) if label.positive]
        return min(positive, default=0.0) >= 0 and all(_is_positive(x, margin) for x in self.bodies())


def pseudo_inertia(inertial: Array) -> Array:
    """The 4x4 pseudo-inertia [[S, h], [h', m]], S = tr(I)/2 - I, of ten inertial parameters.

    Args:
        inertial: (10,) in Pinocchio's order [kg, kg.m, kg.m2].

    Source: Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018, equation 8.
    """
    m, x, y, z, xx, xy, yy, xz, yz, zz = inertial
    rotational = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    second = np.trace(rotational) / 2 * np.eye(3) - rotational
    first = np.array([[x, y, z]])
    return np.block([[second, first.T], [first, np.array([[m]])]])


def _is_positive(inertial: Array, margin: float) -> bool:
    matrix = pseudo_inertia(inertial)
    try:
        np.linalg.cholesky(matrix - margin * np.trace(matrix) * np.eye(4))
    except np.linalg.LinAlgError:
        return False
    return True
