"""Finite Fourier series as a family of motions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ....errors import OptionError
from ....types import Array

RANK = 1e-9  # [1] share of the largest singular value below which an equation repeats another one
DEPENDENT = 1e-7  # [1] length below which a projected unit vector is a combination of those before it


@dataclass(frozen=True)
class Fourier:
    """Series q(t) = q0 + sum over l of a_l / (w l) sin(w l t) - b_l / (w l) cos(w l t), w = 2 pi frequency.

    With `at_rest`, velocity and acceleration vanish at both ends. These are linear equations in a_l and b_l (for whole
    periods: sum a_l = 0, sum l b_l = 0), and the parameters are coordinates in an orthonormal basis of their solutions.

    Source: Swevers, Ganseman, Tukel, De Schutter, Van Brussel, IEEE T-RA 13(5), 1997, equation 12.
    """

    duration: float  # [s]
    harmonics: int
    frequency: float  # [Hz]
    at_rest: bool = True

    @property
    def size(self) -> int:
        return 1 + len(self._free.T)

    def basis(self, t: Array) -> Array:
        """Basis (3, N, d) [1, 1/s, 1/s2] at t (N,) [s]."""
        raw = self._series(np.asarray(t, float))
        constant = np.zeros((3, len(raw[0]), 1))
        constant[0] = 1
        return np.concatenate([constant, raw @ self._free], axis=2)

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


def canonical_null_space(matrix: Array) -> Array:
    """Orthonormal basis (c, d) of the null space that does not depend on the BLAS kernel of the processor.

    The unit vectors, projected onto the null space, are orthonormalised in their order (Gram and Schmidt). The
    projector is unique, while singular vectors of equal singular values are not.

    Args:
        matrix: (r, c) [1] with rows of unit length.
    """
    _, singular, right = np.linalg.svd(matrix)
    rows = right[: np.count_nonzero(singular > RANK * singular[0])]
    projector = np.eye(matrix.shape[1]) - rows.T @ rows
    basis = np.zeros((matrix.shape[1], 0))
    for column in projector:
        for _ in range(2):  # the second time removes the rounding of the first
            column = column - basis @ (basis.T @ column)
        size = np.linalg.norm(column)
        if size > DEPENDENT:
            basis = np.column_stack([basis, column / size])
    return basis


PLUGIN = Fourier
