"""Random motions within limits."""

from __future__ import annotations

import numpy as np

from ...errors import OptionError
from ...types import Array, Robot, Trajectory
from .families import Fourier, combine
from .limits import Limits, build_limits

MANY = 40  # largest number of harmonics
LONGEST = 3600.0  # duration of a motion [s]
MOST_ROWS = 5e6  # of a motion
FREQUENCY, HARMONICS = 0.1, 5  # [Hz] lowest frequency and number of harmonics of `rest_to_rest_motion`
AMPLITUDE = (0.3, 0.8)  # [1] smallest and largest share of the limits that it uses


def random_motion(
    robot: Robot,
    *,
    excursion: float = np.pi / 6,
    harmonics: int = 5,
    frequency: float = 0.05,
    duration: float = 20.0,
    rate: float = 100.0,
    limits: Limits | None = None,
    seed: int = 0,
) -> Trajectory:
    """Random Fourier series with coefficients uniform in [-0.5, 0.5], shifted to its start position.

    All joints are scaled by one factor: the largest excursion [rad or m] from the start is the given one, or less if a
    limit of position, velocity or acceleration requires it. The start is zero, or as near to it as the limits allow.
    Velocity is not zero at the ends. The lowest frequency and the sampling rate are in Hz.

    Raises:
        OptionError: an argument that must be positive is not.
    """
    for name, value in {"excursion": excursion, "harmonics": harmonics, "frequency": frequency, "rate": rate}.items():
        if not value > 0:
            raise OptionError(f"{name} is {value:g}; give a positive number")
    limits, n = limits or build_limits(robot), len(robot.joints)
    family = Fourier(duration, harmonics, frequency, at_rest=False)
    t = np.arange(int(duration * rate + 1.5)) / rate
    basis = family.basis(t)[:, :, 1:]
    q, v, a = basis @ np.random.default_rng(seed).uniform(-0.5, 0.5, (n, 2 * harmonics)).T
    q = q - q[0]
    size = np.abs(q).max()
    scale = min(excursion, limits.half.min()) / size
    start = np.clip(0.0, limits.middle - limits.half + scale * size, limits.middle + limits.half - scale * size)
    scale /= max(1.0, np.abs(limits.shares(start + scale * q, scale * v, scale * a)[1:]).max())
    return Trajectory(robot.joints, t, start + scale * q, scale * v, scale * a)


def random_parameters(
    basis: Array, limits: Limits, rng: np.random.Generator, amplitude: tuple[float, float] = (1.0, 1.0)
) -> Array:
    """Parameters x (n, d) [rad or m] of a random motion of a basis (3, N, d) [1, 1/s, 1/s2].

    Every joint moves about a random centre with a random shape. Its size is a share, uniform in `amplitude`, of the
    largest that its position, velocity and acceleration limits allow. Limits of torque are ignored.
    """
    n, d = len(limits.lower), basis.shape[2]
    x = np.zeros((n, d))
    x[:, 1:] = rng.uniform(-1, 1, (n, d - 1)) * column_sizes(basis, limits)[:, 1:]
    x *= rng.uniform(*amplitude, (n, 1)) * _room(basis, limits, x)[:, None]
    q = combine(basis[0], x)
    least, most = limits.middle - limits.half - q.min(0), limits.middle + limits.half - q.max(0)
    x[:, 0] += least + rng.uniform(0, 1, n) * np.maximum(most - least, 0)
    return x


def fit_inside(basis: Array, limits: Limits, x: Array) -> Array:
    """Parameters x (n, d) [rad or m] scaled and shifted to obey position, velocity and acceleration limits.

    Every joint is scaled and shifted separately, and only as far as needed, on a basis (3, N, d) [1, 1/s, 1/s2].
    """
    scaled = x.copy()
    scaled[:, 1:] *= np.minimum(_room(basis, limits, x), 1.0)[:, None]
    moved = combine(basis[0, :, 1:], scaled[:, 1:])
    least, most = limits.middle - limits.half - moved.min(0), limits.middle + limits.half - moved.max(0)
    scaled[:, 0] = np.clip(x[:, 0], least, np.maximum(least, most))
    return scaled


def column_sizes(basis: Array, limits: Limits) -> Array:
    """Values (n, d) [rad or m] at which each parameter of a basis (3, N, d) [1, 1/s, 1/s2] alone meets a limit."""
    peak = np.maximum(np.abs(basis).max(1), 1e-300)  # (3, d)
    return np.asarray((limits.allowed[:, :, None] / peak[:, None]).min(0))


def check_duration(duration: float, harmonics: int, frequency: float) -> None:
    """Check the duration and the harmonics of a motion.

    Raises:
        OptionError: the duration is shorter than a period of the base frequency, or the number of harmonics is invalid.
    """
    if not (duration > 0 and frequency > 0 and np.isfinite(duration * frequency)):
        raise OptionError(f"the duration is {duration:g} s and the base frequency {frequency:g} Hz; give positive ones")
    if duration * frequency < 1 - 1e-9:
        raise OptionError(
            f"{duration:g} s are shorter than one period of the base frequency {frequency:g} Hz; "
            f"give a duration of at least {1 / frequency:.4g} s, or a base frequency of at least {1 / duration:.4g} Hz"
        )
    if not 1 <= harmonics <= MANY:
        raise OptionError(f"the number of harmonics is {harmonics}; give 1 to {MANY}")


def check_rows(duration: float, rate: float) -> None:
    """Check the size of a motion before any search begins.

    Raises:
        OptionError: the duration [s] is too long, or the rate [Hz] is not positive or gives too many rows.
    """
    if duration > LONGEST:
        raise OptionError(f"the duration is {duration:g} s; give at most {LONGEST:g} s, and repeat the motion")
    if not 0 < rate <= MOST_ROWS / duration:
        fault = f"{duration:g} s at {rate:g} Hz are not between 1 and {MOST_ROWS:.0e} rows"
        raise OptionError(f"{fault}; the rate of the file must be positive, and lower than that")


def at_rate(duration: float, rate: float) -> Array:
    """Instants (N,) [s] from 0 to at most the duration [s], at a rate [Hz]."""
    return np.asarray(np.arange(int(duration * rate + 1e-9) + 1) / rate)


def _room(basis: Array, limits: Limits, x: Array) -> Array:
    """Factors (n,) by which the moving part of x may be scaled until a limit is met."""
    q, v, a = combine(basis[:, :, 1:], x[:, 1:])
    peaks = np.array([np.ptp(q, axis=0) / 2, *np.abs([v, a]).max(1)]) / limits.allowed
    return np.asarray(1 / np.maximum(peaks.max(0), 1e-300))


def rest_to_rest_motion(robot: Robot, duration: float, step: float, seed: int) -> Trajectory:
    """Random Fourier series from rest to rest, within all limits except torque, sampled at a step [s]."""
    t = np.asarray(np.arange(round(duration / step) + 1) * step, dtype=np.float64)
    frequency = max(FREQUENCY, 1 / duration)
    check_duration(duration, HARMONICS, frequency)
    family = Fourier(duration, HARMONICS, frequency)
    coarse = family.basis(t[:: max(1, len(t) // 2000)])
    x = random_parameters(coarse, build_limits(robot), np.random.default_rng(seed), AMPLITUDE)
    return family.sample(robot.joints, x, t)
