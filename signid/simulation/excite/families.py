"""Families of motions: all joints move along the same basis functions of time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...errors import OptionError
from ...types import Array, Trajectory

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

DEPENDENT = 1e-7  # [1] length below which a projected vector is a combination of those before it
DEGREE = 5  # of splines: all derivatives up to the fourth are continuous


@dataclass(frozen=True)
class Family(ABC):
    """Motions that are linear in the parameters x (n, d): q(t) = basis(t)[0] @ x.T, alike velocity, acceleration."""

    duration: float  # [s]
    harmonics: int
    frequency: float  # [Hz] base frequency

    @property
    @abstractmethod
    def size(self) -> int:
        """Number d of parameters of a joint."""

    @abstractmethod
    def basis(self, t: Array) -> Array:
        """Basis (3, N, d) [1, 1/s, 1/s2] of position, velocity, acceleration at t (N,) [s]; column 0 is constant."""

    def sample(self, joints: tuple[str, ...], x: Array, t: Array) -> Trajectory:
        """Motion of parameters x (n, d) [rad or m] at t (N,) [s]."""
        q, v, a = combine(self.basis(t), x)
        return Trajectory(joints, t, q, v, a)


@dataclass(frozen=True)
class Fourier(Family):
    """Series q(t) = q0 + sum over l of a_l / (w l) sin(w l t) - b_l / (w l) cos(w l t), w = 2 pi frequency.

    With `at_rest`, velocity and acceleration vanish at both ends. These are linear equations in a_l and b_l (for whole
    periods: sum a_l = 0, sum l b_l = 0), and the parameters are coordinates in an orthonormal basis of their solutions.

    Source: Swevers, Ganseman, Tukel, De Schutter, Van Brussel, IEEE T-RA 13(5), 1997, equation 12.
    """

    at_rest: bool = True

    @property
    def size(self) -> int:
        return 1 + len(self._free.T)

    def basis(self, t: Array) -> Array:
        raw = self._series(np.asarray(t, float))
        constant = np.zeros((3, len(raw[0]), 1))
        constant[0] = 1
        return np.concatenate([constant, combine(raw, self._free.T)], axis=2)

    def _series(self, t: Array) -> Array:
        """Columns (3, N, 2 L) of a_1..a_L, b_1..b_L."""
        w = 2 * np.pi * self.frequency * np.arange(1, self.harmonics + 1)
        sin, cos = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
        return np.array([np.hstack([sin / w, -cos / w]), np.hstack([cos, sin]), np.hstack([-sin * w, cos * w])])

    @cached_property
    def _free(self) -> Array:
        """Coefficients a_l, b_l (2 L, d - 1) [1] of each parameter."""
        if not self.at_rest:
            return np.eye(2 * self.harmonics)
        ends = self._series(np.array([0.0, self.duration]))[1:].reshape(4, -1)
        free = canonical_null_space(ends / np.linalg.norm(ends, axis=1, keepdims=True))
        if not free.shape[1]:
            raise OptionError(
                f"a Fourier series of {self.harmonics} harmonics cannot start and end at rest; give at least 2 "
                "harmonics for whole periods of the base frequency, else 3"
            )
        return free


@dataclass(frozen=True)
class Spline(Family):
    """Quintic spline q(t) = sum over i of B_i(t) x_i; knots are a quarter of the fastest harmonic's period apart.

    The first three control points are equal, and so are the last three: the motion starts and ends at rest. Column 0 is
    the start position, to which the others add.

    Source: de Boor, A Practical Guide to Splines, 2001, chapter IX.
    """

    @property
    def pieces(self) -> int:
        """Number of intervals between knots."""
        return max(4, int(np.ceil(4 * self.harmonics * self.frequency * self.duration - 1e-9)))

    @property
    def size(self) -> int:
        return self.pieces + DEGREE - 4

    def basis(self, t: Array) -> Array:
        t = np.clip(np.asarray(t, float), 0.0, self.duration)
        return np.array([self._spline.derivative(k)(t) if k else self._spline(t) for k in range(3)])

    @cached_property
    def _spline(self) -> BSpline:
        from scipy.interpolate import BSpline

        inner = np.linspace(0.0, self.duration, self.pieces + 1)
        knots = np.concatenate([np.zeros(DEGREE), inner, np.full(DEGREE, self.duration)])
        control = np.zeros((self.pieces + DEGREE, self.size))
        control[:, 0] = 1
        control[3:-3, 1:-1] = np.eye(self.size - 2)
        control[-3:, -1] = 1
        return BSpline(knots, control, DEGREE)


FAMILIES = {"fourier": Fourier, "spline": Spline}


def combine(basis: Array, x: Array) -> Array:
    """Motions (..., N, n) of parameters x (n, d) in a basis (..., N, d) [units of the basis times those of x].

    The same bytes for every BLAS kernel: matrix products would sum in the order of the kernel.
    """
    return np.asarray(np.einsum("...ij,nj->...in", basis, x))


def steady(values: Array) -> Array:
    """Values, rounded to about seven digits of the largest one.

    values: (N,), or () for one number [any unit].

    A search compares values and follows differences, and so amplifies rounding. Rounded values are the same for every
    BLAS kernel, unless one lies within its rounding error of a half.
    """
    quantum = float(np.spacing(np.float32(np.abs(values).max(initial=0.0))))
    return np.asarray(np.round(values / quantum) * quantum)


def canonical_null_space(matrix: Array) -> Array:
    """Orthonormal basis (c, d) of the null space of a matrix (r, c) [1] with rows of unit length.

    It does not depend on the BLAS kernel of the processor: the rows and then the unit vectors are orthonormalised in
    their order (Gram and Schmidt), without matrix products. Singular vectors of equal singular values are not unique.
    """
    found: list[Array] = []
    for column in matrix:
        _append_orthonormal(found, column)
    rank = len(found)
    for column in np.eye(matrix.shape[1]):
        _append_orthonormal(found, column)
    return np.array(found[rank:]).reshape(-1, matrix.shape[1]).T


def _append_orthonormal(found: list[Array], vector: Array) -> None:
    """Append the part of a vector that is orthogonal to unit vectors, unless it is zero, with unit length."""
    for _ in range(2):  # the second time removes the rounding of the first
        for other in found:
            vector = vector - np.sum(other * vector) * other
    size = np.sqrt(np.sum(vector**2))
    if size > DEPENDENT:
        found.append(vector / size)
