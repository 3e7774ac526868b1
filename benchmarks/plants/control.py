"""Reference motions, controller gains, tracks and their recording, independent of the simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly
from scipy.signal import lfilter

from .faults import Fault

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


CORNER = 3.0  # corner frequency of coloured noise [Hz]
BURST = 4.0  # mean number of rows lost together


def misread(track: Track, joints: Sequence[str], faults: Sequence[Fault]) -> Track:
    """Apply recording faults to a true track at every step: gains, lags and delays, then signs, then swaps."""
    t, q, tau = track.t, track.q.copy(), track.tau.copy()
    orders = ("encoder_offset", "torque_gain", "torque_lag", "time_delay", "torque_sign", "channel_swap")
    for fault in sorted((f for f in faults if f.effect in orders), key=lambda f: orders.index(f.effect)):
        p, at = fault.numbers, slice(None) if fault.joint is None else [joints.index(fault.joint)]
        if fault.effect == "encoder_offset":
            q[:, at] += p["offset"]
        elif fault.effect == "torque_gain":
            tau[:, at] *= 1 + p["error"]
        elif fault.effect == "torque_lag":
            tau[:, at] = _lag(tau[:, at], p["time_constant"] / (t[1] - t[0]))
        elif fault.effect == "time_delay":
            tau[:, at] = np.column_stack([np.interp(t - p["delay"], t, x) for x in tau[:, at].T])
        elif fault.effect == "torque_sign":
            tau[:, at] *= -1
        else:
            pair = [joints.index(str(fault.joint)), joints.index(fault.partner)]
            tau[:, pair] = tau[:, pair[::-1]]
    return Track(t, q, tau)


def misplaced(joints: Sequence[str], faults: Sequence[Fault]) -> Array:
    """Encoder offsets (n,) [rad] of the position loop."""
    offset = np.zeros(len(joints))
    for fault in faults:
        if fault.effect == "encoder_offset":
            offset[joints.index(str(fault.joint))] += fault.numbers["offset"]
    return offset


def log(
    track: Track,
    seed: int,
    bits: int = 17,
    white: float | Array = 0.0,
    coloured: float | Array = 0.0,
    rate: float | None = None,
    jitter: float = 0.0,
    stamping: float = 0.0,
    lost: float = 0.0,
) -> dict[str, Array]:
    """Columns of a recording: t, q_1 ..., tau_1 ...

    Args:
        track: true track.
        seed: seed of the noise and of the encoders' zeros between two counts.
        bits: encoder bits per turn.
        white: standard deviation of white torque noise over the joint's rms torque, scalar or n values.
        coloured: the same for noise through a first-order low-pass at 3 Hz.
        rate: rate of the log [Hz]; default: that of the track.
        jitter: standard deviation of the sampling times, reflected in the time stamps [s].
        stamping: standard deviation of the time stamps about the sampling times [s].
        lost: share of missing rows, some in bursts.
    """
    rng, other = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    period = track.t[1] - track.t[0] if rate is None else 1 / rate
    if rate is not None or jitter:
        track = _sample(track, period, jitter, other)
    count = 2 * np.pi / 2**bits
    zero = rng.uniform(0, count, track.q.shape[1])
    q = np.round((track.q - zero) / count) * count + zero
    size = np.sqrt(np.mean(track.tau**2, axis=0))
    noise = white * rng.standard_normal(track.tau.shape) + coloured * _coloured(rng, track.tau.shape, period)
    columns = {"t": _late(track.t, stamping, other)}
    columns |= {f"q_{j + 1}": x for j, x in enumerate(q.T)}
    columns |= {f"tau_{j + 1}": x for j, x in enumerate((track.tau + size * noise).T)}
    kept = _arrived(len(track.t), lost, other)
    return columns if kept.all() else {key: x[kept] for key, x in columns.items()}


def _lag(x: Array, steps: float) -> Array:
    """First-order low-pass (bilinear) with a time constant of `steps`, settled at the first row."""
    b, a = np.array([1.0, 1.0]) / (1 + 2 * steps), np.array([1.0, (1 - 2 * steps) / (1 + 2 * steps)])
    return np.asarray(lfilter(b, a, x, axis=0, zi=(b[1] - a[1]) * x[:1])[0])


def _sample(track: Track, period: float, jitter: float, rng: np.random.Generator) -> Track:
    """Resample the track at other times by linear interpolation."""
    t = track.t[0] + np.arange(int((track.t[-1] - track.t[0]) / period + 1e-9) + 1) * period
    t = np.clip(_late(t, jitter, rng), track.t[0], track.t[-1])
    q, tau = (np.column_stack([np.interp(t, track.t, column) for column in x.T]) for x in (track.q, track.tau))
    return Track(t, q, tau)


def _late(t: Array, deviation: float, rng: np.random.Generator) -> Array:
    """Add a random error to each time, at most 0.4 rows to preserve their order."""
    if not deviation:
        return t
    most = 0.4 * np.diff(t).min()
    return t + np.clip(deviation * rng.standard_normal(len(t)), -most, most)


def _arrived(rows: int, lost: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Mask (rows,) of kept rows; losses occur in bursts, never at the ends."""
    kept = np.ones(rows, dtype=bool)
    for first in rng.choice(rows, size=round(lost * rows / BURST), replace=False):
        kept[first : first + rng.geometric(1 / BURST)] = False
    kept[[0, -1]] = True
    return kept


def _coloured(rng: np.random.Generator, shape: tuple[int, ...], period: float) -> Array:
    """Coloured noise (N, n) [1] of unit variance, stationary from the first sample."""
    keep = float(np.exp(-2 * np.pi * CORNER * period))
    noise = rng.standard_normal(shape)
    noise[1:] *= np.sqrt(1 - keep**2)
    return np.asarray(lfilter([1.0], [1.0, -keep], noise, axis=0))
