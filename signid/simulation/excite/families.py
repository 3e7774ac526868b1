"""Motions that begin and end at rest: families of parameters, and random ones."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...errors import OptionError
from ...types import Array, Robot, Trajectory
from .limits import Limits, build_limits

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

MAX_DEPENDENT_LENGTH = 1e-7  # [1] length below which a projected vector is a combination of those before it
SPLINE_DEGREE = 5  # of splines: all derivatives up to the fourth are continuous
MAX_HARMONICS = 40  # largest number of harmonics
MAX_DURATION = 3600.0  # duration of a motion [s]
MAX_MOTION_ROWS = 5e6  # [rows] of a motion; heuristic: memory
REST_TO_REST_FREQUENCY, REST_TO_REST_HARMONICS = 0.1, 5  # [Hz] lowest; number of harmonics
REST_TO_REST_SHARES = (0.3, 0.8)  # [1] smallest and largest share of the limits that it uses


@dataclass(frozen=True)
class Family(ABC):
    """Motions that are linear in the parameters x (n, d): q(t) = basis(t)[0] @ x.T, alike velocity, acceleration."""

    duration: float  # [s]
    harmonics: int
    frequency: float  # [Hz] base frequency

    @property
    @abstractmethod
    def size(self) -> int:
        """Number d of parameters of a joint."""

    @abstractmethod
    def basis(self, t: Array) -> Array:
        """Basis (3, N, d) [1, 1/s, 1/s2] of position, velocity, acceleration at t (N,) [s]; column 0 is constant."""

    def sample(self, joints: tuple[str, ...], x: Array, t: Array) -> Trajectory:
        """Motion of parameters x (n, d) [rad or m] at t (N,) [s]."""
        q, v, a = combine_basis(self.basis(t), x)
        return Trajectory(joints, t, q, v, a)


@dataclass(frozen=True)
class Fourier(Family):
    """Series q(t) = q0 + sum over l of a_l / (w l) sin(w l t) - b_l / (w l) cos(w l t), w = 2 pi frequency.

    With `at_rest`, velocity and acceleration vanish at both ends. These are linear equations in a_l and b_l (for whole
    periods: sum a_l = 0, sum l b_l = 0), and the parameters are coordinates in an orthonormal basis of their solutions.

    Source: Swevers, Ganseman, Tukel, De Schutter, Van Brussel, IEEE T-RA 13(5), 1997, equation 12.
    """

    at_rest: bool = True

    @property
    def size(self) -> int:
        return 1 + len(self._free.T)

    def basis(self, t: Array) -> Array:
        raw = self._series(np.asarray(t, float))
        constant = np.zeros((3, len(raw[0]), 1))
        constant[0] = 1
        return np.concatenate([constant, combine_basis(raw, self._free.T)], axis=2)

    def _series(self, t: Array) -> Array:
        """Columns (3, N, 2 L) of a_1..a_L, b_1..b_L."""
        w = 2 * np.pi * self.frequency * np.arange(1, self.harmonics + 1)
        sin, cos = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
        return np.array([np.hstack([sin / w, -cos / w]), np.hstack([cos, sin]), np.hstack([-sin * w, cos * w])])

    @cached_property
    def _free(self) -> Array:
        """Coefficients a_l, b_l (2 L, d - 1) [1] of each parameter."""
        if not self.at_rest:
            return np.eye(2 * self.harmonics)
        ends = self._series(np.array([0.0, self.duration]))[1:].reshape(4, -1)
        free = canonical_null_space(ends / np.linalg.norm(ends, axis=1, keepdims=True))
        if not free.shape[1]:
            raise OptionError(
                f"a Fourier series of {self.harmonics} harmonics cannot start and end at rest; give at least 2 "
                "harmonics for whole periods of the base frequency, else 3"
            )
        return free


@dataclass(frozen=True)
class Spline(Family):
    """Quintic spline q(t) = sum over i of B_i(t) x_i; knots are a quarter of the fastest harmonic's period apart.

    The first three control points are equal, and so are the last three: the motion starts and ends at rest. Column 0 is
    the start position, to which the others add.

    Source: de Boor, A Practical Guide to Splines, 2001, chapter IX.
    """

    @property
    def pieces(self) -> int:
        """Number of intervals between knots."""
        return max(4, int(np.ceil(4 * self.harmonics * self.frequency * self.duration - 1e-9)))

    @property
    def size(self) -> int:
        return self.pieces + SPLINE_DEGREE - 4

    def basis(self, t: Array) -> Array:
        t = np.clip(np.asarray(t, float), 0.0, self.duration)
        return np.array([self._spline.derivative(k)(t) if k else self._spline(t) for k in range(3)])

    @cached_property
    def _spline(self) -> BSpline:
        from scipy.interpolate import BSpline

        inner = np.linspace(0.0, self.duration, self.pieces + 1)
        knots = np.concatenate([np.zeros(SPLINE_DEGREE), inner, np.full(SPLINE_DEGREE, self.duration)])
        control = np.zeros((self.pieces + SPLINE_DEGREE, self.size))
        control[:, 0] = 1
        control[3:-3, 1:-1] = np.eye(self.size - 2)
        control[-3:, -1] = 1
        return BSpline(knots, control, SPLINE_DEGREE)


FAMILIES = {"fourier": Fourier, "spline": Spline}


def combine_basis(basis: Array, x: Array) -> Array:
    """Motions (..., N, n) of parameters x (n, d) in a basis (..., N, d) [units of the basis times those of x].

    The same bytes for every BLAS kernel: matrix products would sum in the order of the kernel.
    """
    return np.asarray(np.einsum("...ij,nj->...in", basis, x))


def steady(values: Array) -> Array:
    """Values, rounded to about seven digits of the largest one.

    values: (N,), or () for one number [any unit].

    A search compares values and follows differences, and so amplifies rounding. Rounded values are the same for every
    BLAS kernel, unless one lies within its rounding error of a half.
    """
    quantum = float(np.spacing(np.float32(np.abs(values).max(initial=0.0))))
    return np.asarray(np.round(values / quantum) * quantum)


def canonical_null_space(matrix: Array) -> Array:
    """Orthonormal basis (c, d) of the null space of a matrix (r, c) [1] with rows of unit length.

    It does not depend on the BLAS kernel of the processor: the rows and then the unit vectors are orthonormalised in
    their order (Gram and Schmidt), without matrix products. Singular vectors of equal singular values are not unique.
    """
    found: list[Array] = []
    for column in matrix:
        _append_orthonormal(found, column)
    rank = len(found)
    for column in np.eye(matrix.shape[1]):
        _append_orthonormal(found, column)
    return np.array(found[rank:]).reshape(-1, matrix.shape[1]).T


def _append_orthonormal(found: list[Array], vector: Array) -> None:
    """Append the part of a vector that is orthogonal to unit vectors, unless it is zero, with unit length."""
    for _ in range(2):  # the second time removes the rounding of the first
        for other in found:
            vector = vector - np.sum(other * vector) * other
    size = np.sqrt(np.sum(vector**2))
    if size > MAX_DEPENDENT_LENGTH:
        found.append(vector / size)


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
    x *= rng.uniform(*amplitude, (n, 1)) * _scale_room(basis, limits, x)[:, None]
    q = combine_basis(basis[0], x)
    least, most = limits.middle - limits.half - q.min(0), limits.middle + limits.half - q.max(0)
    x[:, 0] += least + rng.uniform(0, 1, n) * np.maximum(most - least, 0)
    return x


def fit_inside(basis: Array, limits: Limits, x: Array) -> Array:
    """Parameters x (n, d) [rad or m] scaled and shifted to obey position, velocity and acceleration limits.

    Every joint is scaled and shifted separately, and only as far as needed, on a basis (3, N, d) [1, 1/s, 1/s2].
    """
    scaled = x.copy()
    scaled[:, 1:] *= np.minimum(_scale_room(basis, limits, x), 1.0)[:, None]
    moved = combine_basis(basis[0, :, 1:], scaled[:, 1:])
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
    if not 1 <= harmonics <= MAX_HARMONICS:
        raise OptionError(f"the number of harmonics is {harmonics}; give 1 to {MAX_HARMONICS}")


def check_rows(duration: float, rate: float) -> None:
    """Check the size of a motion before any search begins.

    Raises:
        OptionError: the duration [s] is too long, or the rate [Hz] is not positive or gives too many rows.
    """
    if duration > MAX_DURATION:
        raise OptionError(f"the duration is {duration:g} s; give at most {MAX_DURATION:g} s, and repeat the motion")
    if not 0 < rate <= MAX_MOTION_ROWS / duration:
        fault = f"{duration:g} s at {rate:g} Hz are not between 1 and {MAX_MOTION_ROWS:.0e} rows"
        raise OptionError(f"{fault}; the rate of the file must be positive, and lower than that")


def at_rate(duration: float, rate: float) -> Array:
    """Instants (N,) [s] from 0 to at most the duration [s], at a rate [Hz]."""
    return np.asarray(np.arange(int(duration * rate + 1e-9) + 1) / rate)


def _scale_room(basis: Array, limits: Limits, x: Array) -> Array:
    """Factors (n,) by which the moving part of x may be scaled until a limit is met."""
    q, v, a = combine_basis(basis[:, :, 1:], x[:, 1:])
    peaks = np.array([np.ptp(q, axis=0) / 2, *np.abs([v, a]).max(1)]) / limits.allowed
    return np.asarray(1 / np.maximum(peaks.max(0), 1e-300))


def rest_to_rest_motion(robot: Robot, duration: float, step: float, seed: int) -> Trajectory:
    """Random Fourier series from rest to rest, within all limits except torque, sampled at a step [s]."""
    t = np.asarray(np.arange(round(duration / step) + 1) * step, dtype=np.float64)
    frequency = max(REST_TO_REST_FREQUENCY, 1 / duration)
    check_duration(duration, REST_TO_REST_HARMONICS, frequency)
    family = Fourier(duration, REST_TO_REST_HARMONICS, frequency)
    coarse = family.basis(t[:: max(1, len(t) // 2000)])
    x = random_parameters(coarse, build_limits(robot), np.random.default_rng(seed), REST_TO_REST_SHARES)
    return family.sample(robot.joints, x, t)
