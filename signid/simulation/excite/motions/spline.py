"""Clamped B-splines as a family of motions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline

from ....types import Array

DEGREE = 5  # all derivatives up to the fourth are continuous


@dataclass(frozen=True)
class Spline:
    """Quintic spline q(t) = sum over i of B_i(t) x_i; knots are a quarter of the fastest harmonic's period apart.

    The first three control points are equal, and so are the last three: the motion starts and ends at rest. Column 0 is
    the start position, to which the others add.

    Source: de Boor, A Practical Guide to Splines, 2001, chapter IX.
    """

    duration: float  # [s]
    harmonics: int
    frequency: float  # [Hz]

    @property
    def pieces(self) -> int:
        """Number of intervals between knots."""
        return max(4, int(np.ceil(4 * self.harmonics * self.frequency * self.duration - 1e-9)))

    @property
    def size(self) -> int:
        return self.pieces + DEGREE - 4

    def basis(self, t: Array) -> Array:
        """Basis (3, N, d) [1, 1/s, 1/s2] at t (N,) [s]."""
        t = np.clip(np.asarray(t, float), 0.0, self.duration)
        return np.array([self._spline.derivative(k)(t) if k else self._spline(t) for k in range(3)])

    @cached_property
    def _spline(self) -> BSpline:
        inner = np.linspace(0.0, self.duration, self.pieces + 1)
        knots = np.concatenate([np.zeros(DEGREE), inner, np.full(DEGREE, self.duration)])
        control = np.zeros((self.pieces + DEGREE, self.size))
        control[:, 0] = 1
        control[3:-3, 1:-1] = np.eye(self.size - 2)
        control[-3:, -1] = 1
        return BSpline(knots, control, DEGREE)


PLUGIN = Spline
