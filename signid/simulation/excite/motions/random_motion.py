"""Random motions."""

from __future__ import annotations

import numpy as np

from ....errors import OptionError
from ....types import Array, Robot, Trajectory
from ..limits import Limits, build_limits
from .family import Family
from .fourier import Fourier

MANY = 40  # harmonics at most
FREQUENCY, HARMONICS = 0.1, 5  # [Hz] lowest, and how many, of motions that only move a robot
AMPLITUDE = (0.3, 0.8)  # [1] least and most of what the limits allow to these


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
    """A Fourier series with coefficients uniform in [-0.5, 0.5], shifted to begin at its start position.

    All joints are scaled alike, so that the largest excursion from the start is the one given, or less where a limit of
    position, velocity or acceleration asks for it. The start is zero, or as near to it as the limits allow. Velocity is
    not zero at the ends.

    Args:
        robot: whose joints move.
        excursion: largest of all joints [rad or m].
        harmonics: of the series.
        frequency: the lowest [Hz].
        duration: of the motion [s].
        rate: of its samples [Hz].
        limits: the description's, if None.
        seed: of the coefficients.

    Raises:
        OptionError: a number that must be positive is not.
    """
    for name, value in {"excursion": excursion, "harmonics": harmonics, "frequency": frequency, "rate": rate}.items():
        if not value > 0:
            raise OptionError(f"{name} is {value:g}; a positive number is needed")
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
    """Parameters x (n, d) of a random motion of a family, [rad or m], scaled to its limits but torque's.

    Every joint uses a share, uniform in `amplitude`, of what its position, velocity and acceleration limits allow to
    its random shape, about a random centre.

    Args:
        basis: (3, N, d) [1, 1/s, 1/s2] of the family.
        limits: of n joints.
        rng: random numbers.
        amplitude: least and most share [1].
    """
    n, d = len(limits.lower), basis.shape[2]
    x = np.zeros((n, d))
    x[:, 1:] = rng.uniform(-1, 1, (n, d - 1)) * column_sizes(basis, limits)[:, 1:]
    x *= rng.uniform(*amplitude, (n, 1)) * _room(basis, limits, x)[:, None]
    q = basis[0] @ x.T
    least, most = limits.middle - limits.half - q.min(0), limits.middle + limits.half - q.max(0)
    x[:, 0] += least + rng.uniform(0, 1, n) * np.maximum(most - least, 0)
    return x


def fit_inside(basis: Array, limits: Limits, x: Array) -> Array:
    """The nearest parameters that obey position, velocity and acceleration limits: (n, d) [rad or m].

    Every joint is scaled by itself where it has to be, and shifted where its range asks for it.

    Args:
        basis: (3, N, d) [1, 1/s, 1/s2] of the family.
        limits: of n joints.
        x: (n, d) [rad or m] parameters.
    """
    scaled = x.copy()
    scaled[:, 1:] *= np.minimum(_room(basis, limits, x), 1.0)[:, None]
    moved = basis[0, :, 1:] @ scaled[:, 1:].T
    least, most = limits.middle - limits.half - moved.min(0), limits.middle + limits.half - moved.max(0)
    scaled[:, 0] = np.clip(x[:, 0], least, np.maximum(least, most))
    return scaled


def column_sizes(basis: Array, limits: Limits) -> Array:
    """The size (n, d) [rad or m] at which each parameter alone meets a limit.

    Args:
        basis: (3, N, d) [1, 1/s, 1/s2] of the family.
        limits: of n joints.
    """
    peak = np.maximum(np.abs(basis).max(1), 1e-300)  # (3, d)
    return np.asarray((limits.allowed[:, :, None] / peak[:, None]).min(0))


def check_duration(duration: float, harmonics: int, frequency: float) -> None:
    """Refuse motions that cannot be.

    Raises:
        OptionError: the duration holds no whole period of the base frequency, or there is no harmonic.
    """
    if not (duration > 0 and frequency > 0 and np.isfinite(duration * frequency)):
        raise OptionError(f"duration {duration:g} s and base frequency {frequency:g} Hz must both be positive")
    if duration * frequency < 1 - 1e-9:
        raise OptionError(
            f"{duration:g} s are less than one period of the base frequency {frequency:g} Hz; "
            f"give a duration of at least {1 / frequency:.4g} s, or a base frequency of at least {1 / duration:.4g} Hz"
        )
    if not 1 <= harmonics <= MANY:
        raise OptionError(f"{harmonics} harmonics were asked for; give 1 to {MANY}")


def sample(family: Family, joints: tuple[str, ...], x: Array, t: Array) -> Trajectory:
    """The motion of parameters x (n, d) [rad or m] at t (N,) [s]."""
    q, v, a = family.basis(t) @ x.T
    return Trajectory(joints, t, q, v, a)


def at_rate(duration: float, rate: float) -> Array:
    """(N,) [s] instants from 0 to the duration [s] at most, at a rate [Hz]."""
    return np.asarray(np.arange(int(duration * rate + 1e-9) + 1) / rate)


def _room(basis: Array, limits: Limits, x: Array) -> Array:
    """(n,) factor by which the moving part of x may be scaled until a limit is met."""
    q, v, a = basis[:, :, 1:] @ x[:, 1:].T
    peaks = np.array([np.ptp(q, axis=0) / 2, *np.abs([v, a]).max(1)]) / limits.allowed
    return np.asarray(1 / np.maximum(peaks.max(0), 1e-300))


def rest_to_rest_motion(robot: Robot, duration: float, step: float, seed: int) -> Trajectory:
    """A Fourier series at random within the limits but torque's, from rest to rest, told at every step [s].

    Raises:
        OptionError: it would be shorter than a step.
    """
    t = np.asarray(np.arange(round(duration / step) + 1) * step, dtype=np.float64)
    frequency = max(FREQUENCY, 1 / duration)
    check_duration(duration, HARMONICS, frequency)
    family = Fourier(duration, HARMONICS, frequency)
    coarse = family.basis(t[:: max(1, len(t) // 2000)])
    x = random_parameters(coarse, build_limits(robot), np.random.default_rng(seed), AMPLITUDE)
    return sample(family, robot.joints, x, t)
