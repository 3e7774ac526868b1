"""Motions of the recordings: Fourier series that return every eight seconds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .robots import Place

Array = NDArray[np.float64]

PERIOD, PERIODS = 8.0, 2  # s, and how many a recording has
ORDERS = np.array([1, 2, 3, 5, 8, 12])  # of the harmonics
SPEED = 2.2  # rad/s at most
ASIDE, SMALLER = 0.3, 0.7  # rad that a motion's centre differs by, and the least share of the reach that it uses


class Fourier(NamedTuple):
    """Sums of sine and cosine about a centre, n joints."""

    sine: Array  # (6, n) [rad]
    cosine: Array  # (6, n) [rad]
    centre: Array  # (n,) [rad]

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity, acceleration, (N, n) each [rad, rad/s, rad/s2] at times (N,) [s]."""
        w = 2 * np.pi / PERIOD * ORDERS[:, None]
        s, c = np.sin(t[:, None] * w.T), np.cos(t[:, None] * w.T)
        v = c @ (self.sine * w) - s @ (self.cosine * w)
        return self.centre + s @ self.sine + c @ self.cosine, v, -s @ (self.sine * w**2) - c @ (self.cosine * w**2)


def draw(place: Place, rng: np.random.Generator) -> Fourier:
    """A random motion about the place, as large as its reach or the speed allows."""
    n = len(place.centre)
    sine, cosine = rng.standard_normal((2, len(ORDERS), n)) / np.sqrt(ORDERS)[:, None]
    q, v, _ = Fourier(sine, cosine, np.zeros(n)).at(np.arange(0, PERIOD, 0.01))
    reach = place.reach * rng.uniform(SMALLER, 1, n)
    scale = np.minimum(reach / np.abs(q).max(0), SPEED / np.abs(v).max(0))
    return Fourier(sine * scale, cosine * scale, np.array(place.centre) + rng.uniform(-ASIDE, ASIDE, n))
