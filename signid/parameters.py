"""Standard and base parameters with their labels.

Shapes: n independent joints, nb bodies, p standard parameters, b base parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .frozen import Frozen, Result

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
INERTIAL = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")  # Pinocchio's order
INERTIAL_UNITS = ("kg", *("kg.m",) * 3, *("kg.m2",) * 6)
TWO_SIDED = 1.96  # half-width of a 95 % confidence interval of a normal distribution [standard deviations]


@dataclass(frozen=True)
class Label:
    """Label of a standard parameter: an inertial parameter of a body, or a coefficient of a law."""

    name: str  # "Izz_2", "armature_1"
    unit: str
    body: int | None = None  # 0-based body of the model, for inertial parameters
    law: int | None = None  # index of its law
    joint: int | None = None  # column of the law's joint
    positive: bool = False  # negative values are unphysical


@dataclass(frozen=True, eq=False)
class BaseMap(Result):
    """Identifiable combinations of the standard parameters: base = combination @ standard."""

    labels: tuple[Label, ...]  # p
    independent: Indices  # (b,) leading standard parameter of each combination
    combination: Array  # (b, p) [unit of base over unit of standard]
    expressions: tuple[str, ...]  # b formulas, "Izz_2 + 0.09 m_3"
    units: tuple[str, ...]  # b
    sees: Mask  # (n, b) whether the torque of a joint depends on a base parameter
    singular_values: Array  # (p,) [1] of the scaled regressor on random states, descending
    condition: float  # condition number of the kept columns, scaled

    @property
    def rank(self) -> int:
        return len(self.independent)

    @property
    def invisible(self) -> tuple[Label, ...]:
        """Standard parameters without influence on the torque of any motion."""
        seen = np.abs(self.combination).max(0, initial=0.0) > 0
        return tuple(label for label, s in zip(self.labels, seen, strict=True) if not s)


@dataclass(frozen=True, eq=False)
class Estimate(Result):
    """Estimated base parameters and their covariance."""

    value: Array  # (b,) [units of base]
    covariance: Array  # (b, b) [units of base]; infinite variance where unidentifiable
    information: Array  # (b, b) [1/units of base] information matrix: Gram matrix weighted by the noise
    noise: Array  # (n,) [N.m or N] standard deviation of the decimated residual
    orders: tuple[int, ...]  # (n,) order of the autoregressive noise model
    method: str = "weighted least squares"
    notes: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()  # limitations of the result
    names: tuple[str, ...] = ()  # b formulas of an identification, "Izz_2 + 0.09 m_3"
    units: tuple[str, ...] = ()  # b
    spread: Array | None = None  # (b,) [units of base] standard deviation between recordings, 0: agree; None: only one

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
        """Whether all pseudo-inertias are positive definite, and friction and armature are >= 0.

        Verified by Cholesky factorisation of pseudo-inertia - margin * trace, independently of any solver.

        Source: Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018.
        """
        positive = [value for label, value in zip(self.labels, self.values, strict=True) if label.positive]
        return min(positive, default=0.0) >= 0 and all(_is_positive(x, margin) for x in self.bodies())


def pseudo_inertia(inertial: Array) -> Array:
    """Pseudo-inertia (4, 4) [[S, h], [h', m]], S = tr(I)/2 - I, of ten inertial parameters.

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
