"""What a family of motions is: every joint moves along the same basis functions of time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from ....registry import Registry
from ....types import Array


class Family(Protocol):
    """Position, velocity and acceleration are linear in the parameters x (n, d): q(t) = basis(t)[0] @ x.T."""

    @property
    def duration(self) -> float:
        """Duration of the motion [s]."""
        ...

    @property
    def size(self) -> int:
        """How many parameters d a joint has."""
        ...

    def basis(self, t: Array) -> Array:
        """(3, N, d) [1, 1/s, 1/s2] of position, velocity and acceleration at t (N,) [s]; column 0 is the constant."""
        ...


Build = Callable[[float, int, float], Family]  # duration [s], harmonics, base frequency [Hz]
FAMILIES: Registry[Build] = Registry("motions", __package__, "fourier spline")
