"""Motions that are asked for, the loop that follows them, and what comes of it; no simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly

Array = NDArray[np.float64]

STEP = 2.5e-4  # s, of the simulation
COMMAND = 4  # steps between two values of the feed-forward
BANDWIDTH, DAMPING = 2 * np.pi * 8.0, 0.9  # rad/s and 1, of the position loop
KNOWN = 0.9  # share of the dynamics that the feed-forward knows
HARMONICS, FUNDAMENTAL = 10, 0.1  # of a motion: their number, and the first [Hz]
SPEED, ACCELERATION, RANGE = 1.5, 5.0, 1.0  # rad/s, rad/s2, rad that a motion keeps within


class Reference(Protocol):
    """Any motion that can be asked for."""

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity, acceleration, (N, n) each [rad, rad/s, rad/s2] at times (N,) [s]."""


class Motion(NamedTuple):
    """Positions as Fourier series, n joints: sums of sine / frequency - cosine / frequency about a centre."""

    sine: Array  # (HARMONICS, n) [rad/s]
    cosine: Array  # (HARMONICS, n) [rad/s]
    centre: Array  # (n,) [rad]

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity, acceleration, (N, n) each [rad, rad/s, rad/s2] at times (N,) [s]."""
        w = 2 * np.pi * FUNDAMENTAL * np.arange(1, HARMONICS + 1)[:, None]
        s, c = np.sin(t[:, None] * w.T), np.cos(t[:, None] * w.T)
        q = s @ (self.sine / w) - c @ (self.cosine / w) + self.centre
        return q, c @ self.sine + s @ self.cosine, c @ (self.cosine * w) - s @ (self.sine * w)


@dataclass(frozen=True, eq=False)
class Table:
    """A motion by its rows, any rate: between them polynomials that keep all three; at rest before and after."""

    t: Array  # (M,) [s]
    q: Array  # (M, n) [rad]
    v: Array  # (M, n) [rad/s]
    a: Array  # (M, n) [rad/s2]

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity, acceleration, (N, n) each [rad, rad/s, rad/s2] at times (N,) [s]."""
        curve = BPoly.from_derivatives(self.t, np.stack([self.q, self.v, self.a], axis=1))
        within = np.clip(t, self.t[0], self.t[-1])
        moving = ((t >= self.t[0]) & (t <= self.t[-1]))[:, None]
        return curve(within), curve(within, 1) * moving, curve(within, 2) * moving


class Track(NamedTuple):
    """What the robot itself would tell without noise; without faults of recording, what truly happened."""

    t: Array  # (N,) [s]
    q: Array  # (N, n) [rad]
    tau: Array  # (N, n) [N.m]


def draw_motion(
    centre: Sequence[float], seed: int, speed: float = SPEED, acceleration: float = ACCELERATION, reach: float = RANGE
) -> Motion:
    """A random motion as large as speed [rad/s], acceleration [rad/s2] and range [rad] allow.

    Args:
        centre: (n,) [rad].
        seed: of the series' coefficients.
        speed: of each joint at most.
        acceleration: of each joint at most.
        reach: from the centre at most.
    """
    order = np.arange(1, HARMONICS + 1)[:, None]
    sine, cosine = np.random.default_rng(seed).standard_normal((2, HARMONICS, len(centre))) / order**1.2
    period = np.arange(0, 1 / FUNDAMENTAL, 1e-3)
    sizes = [np.abs(x).max(0) for x in Motion(sine, cosine, np.zeros(len(centre))).at(period)]
    limits = (reach, speed, acceleration)
    scale = np.min([limit / size for limit, size in zip(limits, sizes, strict=True)], axis=0)
    return Motion(sine * scale, cosine * scale, np.array(centre, dtype=float))


def clock(start: float, duration: float, rate: float) -> tuple[Array, int]:
    """Times of all steps (N,) [s], and how many steps lie between two rows of the log.

    Raises:
        ValueError: when the log would fall between the steps.
    """
    every = round(1 / (rate * STEP))
    if abs(every * rate * STEP - 1) > 1e-9:
        raise ValueError(f"a log at {rate:g} Hz falls between the steps of {STEP:g} s")
    return start + np.arange(round(duration / STEP) + 1) * STEP, every


def gains(inertia: Array, bandwidth: float = BANDWIDTH) -> tuple[Array, Array]:
    """Stiffness and damping of the position loop, (n,) each [N.m/rad, N.m.s/rad], for inertia (n,) [kg.m2]."""
    return inertia * bandwidth**2, 2 * DAMPING * inertia * bandwidth
