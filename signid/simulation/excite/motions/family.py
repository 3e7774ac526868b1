"""Family of motions: all joints move along the same basis functions of time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from ....registry import Registry
from ....types import Array


class Family(Protocol):
    """Motions that are linear in the parameters x (n, d): q(t) = basis(t)[0] @ x.T, alike velocity, acceleration."""

    @property
    def duration(self) -> float:
        """Duration of the motion [s]."""
        ...

    @property
    def size(self) -> int:
        """Number d of parameters of a joint."""
        ...

    def basis(self, t: Array) -> Array:
        """Basis (3, N, d) [1, 1/s, 1/s2] of position, velocity, acceleration at t (N,) [s]; column 0 is constant."""
        ...


Build = Callable[[float, int, float], Family]  # duration [s], harmonics, base frequency [Hz]
FAMILIES: Registry[Build] = Registry("motions", __package__, "fourier spline")
