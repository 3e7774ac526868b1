"""Reference motions, controller gains and tracks, independent of the simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly

Array = NDArray[np.float64]

STEP = 2.5e-4  # time step of the simulation [s]
COMMAND = 4  # steps between two feed-forward values
BANDWIDTH, DAMPING = 2 * np.pi * 8.0, 0.9  # bandwidth [rad/s] and damping ratio [1] of the position loop
KNOWN = 0.9  # share of the dynamics in the feed-forward [1]
HARMONICS, FUNDAMENTAL = 10, 0.1  # number of harmonics, fundamental frequency [Hz]
SPEED, ACCELERATION, RANGE = 1.5, 5.0, 1.0  # limits of a motion [rad/s], [rad/s2], [rad]


class Reference(Protocol):
    """Protocol of reference motions."""

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity, acceleration, (N, n) each [rad, rad/s, rad/s2] at times (N,) [s]."""


class Motion(NamedTuple):
    """Fourier motion of n joints: sums of sine / frequency - cosine / frequency about a centre."""

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
    """Motion from rows at any rate, interpolated by polynomials that match q, v and a; at rest before and after."""

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
    """Noise-free signals of the robot, after recording faults if any are planted."""

    t: Array  # (N,) [s]
    q: Array  # (N, n) [rad]
    tau: Array  # (N, n) [N.m]


def draw_motion(
    centre: Sequence[float], seed: int, speed: float = SPEED, acceleration: float = ACCELERATION, reach: float = RANGE
) -> Motion:
    """Draw a random motion, scaled up to the limits of speed [rad/s], acceleration [rad/s2] and range [rad].

    Args:
        centre: centre of the motion (n,) [rad].
        seed: seed of the series coefficients.
        speed: largest speed of each joint.
        acceleration: largest acceleration of each joint.
        reach: largest distance from the centre.
    """
    order = np.arange(1, HARMONICS + 1)[:, None]
    sine, cosine = np.random.default_rng(seed).standard_normal((2, HARMONICS, len(centre))) / order**1.2
    period = np.arange(0, 1 / FUNDAMENTAL, 1e-3)
    sizes = [np.abs(x).max(0) for x in Motion(sine, cosine, np.zeros(len(centre))).at(period)]
    limits = (reach, speed, acceleration)
    scale = np.min([limit / size for limit, size in zip(limits, sizes, strict=True)], axis=0)
    return Motion(sine * scale, cosine * scale, np.array(centre, dtype=float))


def clock(start: float, duration: float, rate: float) -> tuple[Array, int]:
    """Times of all steps (N,) [s] and number of steps per row of the log.

    Raises:
        ValueError: when the log period is not a multiple of the step.
    """
    every = round(1 / (rate * STEP))
    if abs(every * rate * STEP - 1) > 1e-9:
        raise ValueError(f"a log at {rate:g} Hz is not a multiple of the step of {STEP:g} s")
    return start + np.arange(round(duration / STEP) + 1) * STEP, every


def gains(inertia: Array, bandwidth: float = BANDWIDTH) -> tuple[Array, Array]:
    """Gains of the position loop, (n,) each [N.m/rad, N.m.s/rad], for inertia (n,) [kg.m2]."""
    return inertia * bandwidth**2, 2 * DAMPING * inertia * bandwidth
