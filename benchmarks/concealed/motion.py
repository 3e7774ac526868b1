"""Motions of the recordings: Fourier series with a period of eight seconds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .robots import Place

Array = NDArray[np.float64]

PERIOD, PERIODS = 8.0, 2  # period [s], periods per recording
ORDERS = np.array([1, 2, 3, 5, 8, 12])  # orders of the harmonics
SPEED = 2.2  # largest joint speed [rad/s]
ASIDE, SMALLER = 0.3, 0.7  # largest shift of a motion's centre [rad], smallest used share of the reach [1]


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
    """Draw a random motion about the place, scaled to the limit of reach or speed."""
    n = len(place.centre)
    sine, cosine = rng.standard_normal((2, len(ORDERS), n)) / np.sqrt(ORDERS)[:, None]
    q, v, _ = Fourier(sine, cosine, np.zeros(n)).at(np.arange(0, PERIOD, 0.01))
    reach = place.reach * rng.uniform(SMALLER, 1, n)
    scale = np.minimum(reach / np.abs(q).max(0), SPEED / np.abs(v).max(0))
    return Fourier(sine * scale, cosine * scale, np.array(place.centre) + rng.uniform(-ASIDE, ASIDE, n))
