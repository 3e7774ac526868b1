"""Recording of a track: recording faults, sampling, encoders and noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from .control import Track
from .faults import Fault

Array = NDArray[np.float64]

CORNER = 3.0  # corner frequency of coloured noise [Hz]
BURST = 4.0  # mean number of rows lost together


def misread(track: Track, joints: Sequence[str], faults: Sequence[Fault]) -> Track:
    """Apply recording faults: first gain, lag and delay of each drive, then signs, then swapped channels.

    Args:
        track: true track at every step.
        joints: joint names (n,).
        faults: all planted faults; only recording faults are used.
    """
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
