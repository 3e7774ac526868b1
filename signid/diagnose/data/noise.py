"""Noise of each joint, estimated from residuals, and whitening of rows against it and model discrepancy.

Noise is autoregressive, with uncertain times of reversals; discrepancy is torque of a joint that no law explains.

Per joint, y = X a + S b + d(q, v, load, direction) + e, where d is a zero-mean Gaussian process of size s with a
stationary kernel. With F random frequencies, d = Z w with w ~ N(0, s^2 I): the covariance s^2 Z Z' has rank 2 F, and
rows are whitened by a projection:

    (I + s^2 Z Z')^-1/2 = I - U (I - (I + D^2)^-1/2) U',    s Z = U D V' (singular values D).

s maximises the marginal likelihood of the rows; all fitted coefficients are integrated out.

Source: Kennedy, O'Hagan, Bayesian calibration of computer models, J. R. Statist. Soc. B 63(3), 2001 (discrepancy);
Gelman, Bayesian Analysis 1(3), 2006 (half-Cauchy prior of its size);
Rahimi, Recht, Random features for large-scale kernel machines, NIPS 2007 (features).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import block_diag
from scipy.linalg.lapack import dgtsv, dormqr, dsterf, dsytrd

from ...effects.base import ActuatorLaw
from ...regression.bandwidth import Band
from ...regression.factors import Misfit
from ...regression.projection import least_squares, leave
from ...types import Array, Frozen, Indices, Mask
from .. import thresholds as tuned
from .locate import find_wave
from .rows import RowTable

FREQUENCY_COUNT = 40  # F, number of random frequencies. Heuristic
FEATURE_SEED = 0  # seed of the random frequencies
# [1] grid of s, as a share of the joint's rms torque. Heuristic
DISCREPANCY_GRID = (0.0, 0.001, 0.002, 0.004, 0.008, 0.015, 0.03, 0.06, 0.12, 0.25)
GRID_STRIDE = 3  # every 3rd size of the grid is evaluated first
LAPACK_BLOCK = 32  # columns that LAPACK reduces at once
EM_STEPS = 8  # steps of expectation and maximisation, from a variance of 1. Heuristic
PRIOR_ROOT_RIDGE = 1e-10  # [1] added to the diagonal of the scaled precision, so that it can be factored
MIN_PERIOD = 1.0  # [s] shortest period of a motion. Heuristic
MAX_PERIOD_SHARE = 0.55  # [1] longest period, as a share of the recording: nearly two periods are compared. Heuristic
COLUMN_RANK_TOLERANCE = 1e-4  # [1] smallest singular value that counts, over the largest, of scaled columns. Heuristic
MIN_REVERSAL_ROWS = 6  # rows near reversals; with fewer, the scale is not estimated. Heuristic
CHI2_MEDIAN = 0.455  # [1] median of the chi-squared distribution with one degree of freedom


class Projection(NamedTuple):
    """Whitening of rows against the discrepancy of one joint: (I + s^2 Z Z')^-1/2."""

    basis: Array  # (M, k) [1] U, orthonormal columns
    shrinkage: Array  # (k,) [1] 1 - (1 + D^2)^-1/2 of each direction

    def __call__(self, x: Array) -> Array:
        """(M, c) [1] rows x (M, c) [1] in units of the noise, after whitening."""
        return np.asarray(x - self.basis @ (self.shrinkage[:, None] * (self.basis.T @ x)))


def features(table: RowTable, joint: int) -> Array:
    """(M, 2 F) [1] Z: random Fourier features of a joint's state, orthogonal to linear functions of it.

    Scaled such that the squares of a row sum to 1 on average.

    Source: Rahimi, Recht, NIPS 2007; Plumlee, J. Am. Stat. Assoc. 112, 2017 (the orthogonal process).
    """
    v = table.v[:, joint]
    turn = tuned.DIRECTION_WIDTH * max(float(np.sqrt(np.mean(v**2))), 1e-12)
    state = [table.q[:, joint], v, table.predicted[:, joint]]
    x = np.column_stack([*((x - x.mean()) / (np.std(x) or 1.0) for x in state), np.tanh(v / turn)])
    rng = np.random.default_rng(FEATURE_SEED)
    frequency = rng.standard_normal((x.shape[1], FREQUENCY_COUNT)) / np.resize(
        tuned.DISCREPANCY_LENGTHS, FREQUENCY_COUNT
    )
    angle = x @ frequency
    linear = np.column_stack([np.ones(len(x)), x])
    beyond = leave(np.column_stack([np.cos(angle), np.sin(angle)]), linear)
    return np.asarray(beyond / max(float(np.sqrt(np.sum(beyond**2) / len(beyond))), 1e-12))


def project(white: Array, size: float) -> Projection:
    """Whitening against a discrepancy of some size [N.m or N]; white (M, f) [1 / N.m] is Z in units of the noise."""
    basis, singular, _ = np.linalg.svd(size * white, full_matrices=False)
    return Projection(basis, 1 - 1 / np.sqrt(1 + singular**2))


class NoiseEstimate(NamedTuple):
    """Noise variance and discrepancy of one joint, and the fit under them."""

    size: float  # size s of the discrepancy [N.m or N]
    variance: float  # c, variance of the noise over the presumed one [1]
    value: Array  # (f,) [unit of each coefficient] posterior mean of a, b and w, f = k + 2 F
    used: float  # effective number of parameters of the fit
    log: float  # log marginal likelihood of the rows, with the prior of s, up to a constant [-]


def estimate_discrepancy(white: Array, fitted: Array, precision: Array, residual: Array, scale: float) -> NoiseEstimate:
    """Estimate the size of the discrepancy and the variance of the noise by maximum marginal likelihood.

    In units of the noise, white (M, f) [1 / N.m] is Z, f = 2 F, and residual (M,) [1] is y. The columns X and S of the
    fit are fitted (M, k) [1 per coefficient], their precision (k, k) [1 per coefficient, squared] is L. The scale is
    the rms torque of the joint [N.m or N].

    Source: Dempster, Laird, Rubin, J. R. Statist. Soc. B 39(1), 1977 (expectation and maximisation for the
    variance); Gelman, Bayesian Analysis 1(3), 2006 (prior of s).
    """
    columns = np.column_stack([fitted, white])
    gram, right, square = columns.T @ columns, columns.T @ residual, float(residual @ residual)
    k, rows = fitted.shape[1], max(int(np.count_nonzero(residual)), 1)
    flat = np.where(np.diag(precision) > 0, 0.0, tuned.FLAT_PRECISION * np.maximum(np.diag(gram)[:k], 1e-12))
    prior = precision + np.diag(flat)
    size = np.sqrt(np.maximum(np.diag(prior), 1e-300))
    lower = np.linalg.cholesky(prior / size / size[:, None] + PRIOR_ROOT_RIDGE * np.eye(k))
    # R of the coefficients R u with u ~ N(0, I), for s = scale
    root = block_diag(np.linalg.inv(lower).T / size[:, None], scale * np.eye(white.shape[1]))
    gram, right = root.T @ gram @ root, root.T @ right

    def at(share: float) -> NoiseEstimate:
        weight = np.append(np.ones(k), np.full(white.shape[1], share))
        whole = _maximise_variance(gram * weight * weight[:, None], right * weight, square, rows)
        log = whole.log - float(np.log1p((share / tuned.DISCREPANCY_SCALE) ** 2))
        return whole._replace(size=share * scale, value=root @ (weight * whole.value), log=log)

    # a coarse search of the grid, then an ascent over neighbours
    found = {n: at(DISCREPANCY_GRID[n]) for n in range(0, len(DISCREPANCY_GRID), GRID_STRIDE)}
    while True:
        best = max(found, key=lambda n: found[n].log)
        near = [n for n in (best - 1, best + 1) if 0 <= n < len(DISCREPANCY_GRID) and n not in found]
        if not near:
            return found[best]
        found |= {n: at(DISCREPANCY_GRID[n]) for n in near}


def _maximise_variance(gram: Array, right: Array, square: float, rows: int) -> NoiseEstimate:
    """Maximise the marginal likelihood over the noise variance, for coefficients of unit prior.

    An orthogonal Q makes Q' gram Q tridiagonal and all of Q' right zero but its first value: no eigenvectors needed.
    """
    bordered = np.block([[np.zeros((1, 1)), right[None]], [right[:, None], gram]])
    turn, diagonal, beside, reflections, _ = dsytrd(bordered, lower=1, lwork=LAPACK_BLOCK * len(bordered))
    first = np.append(beside[0], np.zeros(len(right) - 1))  # Q' right
    diagonal, beside, variance = diagonal[1:], beside[1:], 1.0
    eigen = np.maximum(dsterf(diagonal, beside)[0], 0.0)
    for last in (*[False] * EM_STEPS, True):
        value = dgtsv(beside, diagonal + variance, beside, first)[3]
        rest = max(square - float(value @ (first + variance * value)), 0.0)
        used = float(np.sum(eigen / (eigen + variance)))
        if not last:
            variance = max((rest + variance * used) / rows, 1e-12)
    log = -(rest / variance + float(value @ value) + float(np.sum(np.log1p(eigen / variance)))) / 2
    value = dormqr("L", "N", turn[1:, :-1], reflections, value[:, None], LAPACK_BLOCK)[0][:, 0]
    return NoiseEstimate(0.0, variance, value, used, log - rows / 2 * float(np.log(variance)))


@dataclass(frozen=True, eq=False)
class Whitening(Frozen):
    """Whitening of rows against coloured noise and model discrepancy, joint by joint."""

    table: RowTable
    noise: Noise
    _projections: dict[int, Projection] = field(default_factory=dict, init=False)

    def local(self, columns: Mapping[int, Array]) -> dict[int, Array]:
        """Whiten columns (M, k) [torque per coefficient] of each joint against coloured noise alone."""
        noise, piece = self.noise, self.table.piece
        return {
            j: whiten(x, noise.coefficients[j], float(noise.innovation[j]), piece) * self._weight[:, j, None]
            for j, x in columns.items()
        }

    def __call__(self, columns: Mapping[int, Array]) -> dict[int, Array]:
        """Whitened columns (M, k) [torque per coefficient] of each joint, against noise and discrepancy."""
        local = self.local(columns)
        return {j: x if (onto := self._projection(j)) is None else onto(x) for j, x in local.items()}

    def log_scale(self, joint: int) -> float:
        """Log determinant of the whitening of a joint's rows [-]."""
        weight, projection = self._weight[:, joint], self._projection(joint)
        counted = weight[weight > 0]
        own = float(np.sum(np.log(counted))) - len(counted) * float(np.log(self.noise.innovation[joint]))
        return own if projection is None else own + float(np.sum(np.log1p(-projection.shrinkage)))

    @cached_property
    def _weight(self) -> Array:
        """(M', n) [1] weights of whitened rows."""
        return weights(self.table, self.noise)

    def _projection(self, joint: int) -> Projection | None:
        size = float(self.noise.discrepancy[joint])
        if size > 0 and joint not in self._projections:
            white = self.local({joint: features(self.table, joint)})[joint]  # Z in units of the noise
            self._projections[joint] = project(white, size)
        return self._projections.get(joint)


def moving(table: RowTable, order: int) -> Mask:
    """(M, n) whitened rows whose whole window is in motion."""
    still = np.asarray(np.array([table.at_rest[order - k : len(table) - k] for k in range(order + 1)]).any(axis=0))
    return np.asarray(~still[has_full_window(table.piece, order)])


def weights(table: RowTable, noise: Noise) -> Array:
    """(M, n) [1] weights of whitened rows: reduced near velocity reversals, zero at rest."""
    order = noise.coefficients.shape[1]
    unsure = np.max([table.reversal_std[order - k : len(table) - k] for k in range(order + 1)], axis=0)
    weight = 1 / np.sqrt(1 + (np.maximum(noise.reversal_scale, 1) * unsure / noise.saturated_floor) ** 2)
    return np.asarray(weight[has_full_window(table.piece, order)] * moving(table, order))


@dataclass(frozen=True, eq=False)
class Noise(Frozen):
    """Autoregressive noise model of each joint, and the size of its discrepancy."""

    floor: Array  # (n,) [N.m or N] rms of the noise
    coefficients: Array  # (n, 4) [1] autoregressive coefficients of the last four rows
    innovation: Array  # (n,) [N.m or N] standard deviation of the innovation
    discrepancy: Array  # (n,) [N.m or N] s, size of the model discrepancy
    saturated_floor: Array  # (n,) [N.m or N] rms of the residual of a fit of all columns: floor of the verdict
    reversal_scale: Array  # (n,) [1] estimated over presumed standard deviation near reversals

    def white(self) -> Noise:
        """The same rms as white noise."""
        return replace(self, coefficients=np.zeros_like(self.coefficients), innovation=self.floor)


def measure_noise(table: RowTable, periods: Sequence[float | None], rate: float) -> Noise:
    """Estimate the noise from the residual of all columns, or from repetitions of the motion if that gives less noise.

    Source: autoregressive prewhitening as in Ljung, System Identification, 1999, section 14.4.
    """
    used = _columns_in_fit(table)
    found = list[tuple[float, Array, float, float]]()
    for j in range(table.joints):
        rest, reversal_std, factor = _saturated(table, j, used)
        choices = [_fit(rest, factor, _reliable(rest, reversal_std, float(table.scale[j])))]
        if again := _replicates(table, j, periods, rate):
            choices.append(_fit(again, tuned.REPLICATE_FACTOR, [np.ones(len(x), dtype=bool) for x in again]))
        best = min(choices, key=lambda choice: choice[0])
        reversal_scale = _reversal_scale(factor * np.concatenate(rest), np.concatenate(reversal_std), best[0])
        found.append((*best, reversal_scale))
    floor, coefficients, innovation, scale = (np.array(x) for x in zip(*found, strict=True))
    return Noise(floor, coefficients, innovation, np.zeros(table.joints), floor, scale)


def noise_of_misfit(noise: Noise, misfit: Misfit, band: Band) -> Noise:
    """Noise of an identified model: the misfit that its laws left then, where it is more than that of the rows.

    Rows within its length count as one. A wider band than the identification's is taken to hold more of it.
    """
    wider = np.sqrt(max(band.cutoff / misfit.cutoff, 1.0))
    floor = np.fmax(noise.floor, misfit.size * wider)
    rows = np.fmax(misfit.length * band.rate / band.factor, 1.0)
    innovation = np.where(np.isfinite(misfit.size), floor * np.sqrt(rows), floor)
    return Noise(
        floor=floor,
        coefficients=np.zeros_like(noise.coefficients),
        innovation=innovation,
        discrepancy=np.zeros_like(floor),
        saturated_floor=floor,
        reversal_scale=noise.reversal_scale,
    )


def find_period(q: Array, rate: float) -> float | None:
    """Shortest period [s] after which all uniformly sampled positions q (N, n) [rad or m] repeat; None if none does."""
    count, spread = len(q), q.std(0)
    x = (q - q.mean(0))[:, spread > 1e-9] / spread[spread > 1e-9]
    least, most = round(MIN_PERIOD * rate), int(MAX_PERIOD_SHARE * count)
    if x.shape[1] == 0 or most <= least + 2:
        return None
    spectrum = np.fft.rfft(x, 1 << (2 * count).bit_length(), axis=0)
    product = np.fft.irfft(np.sum(np.abs(spectrum) ** 2, axis=1))[:count]
    power = np.append(0.0, np.cumsum(np.sum(x**2, axis=1)))
    lags = np.arange(count)
    square = (power[count - lags] + power[count] - power[lags] - 2 * product) / np.maximum(count - lags, 1) / x.shape[1]
    apart = np.sqrt(np.maximum(square, 0))[least:most]
    lows = np.flatnonzero((apart[1:-1] <= apart[:-2]) & (apart[1:-1] <= apart[2:])) + 1
    good = lows[apart[lows] < tuned.PERIOD_TOLERANCE]
    return float((good[0] + least) / rate) if len(good) else None


def whiten(x: Array, coefficients: Array, innovation: float, piece: Indices) -> Array:
    """(M', c) [1] rows x (M, c) [N.m or N] after a filter: coefficients (4,) [1]; each piece (M,) loses four rows."""
    order = len(coefficients)
    out = x[order:] - sum(c * x[order - 1 - k : len(x) - 1 - k] for k, c in enumerate(coefficients))
    return np.asarray(out[has_full_window(piece, order)] / innovation)


def has_full_window(piece: Indices, order: int) -> Mask:
    """(M - order,) whether the `order` rows before a row are of the same piece (M,), from the `order`-th row on."""
    return np.asarray(piece[order:] == piece[:-order])


def noise_of_rest(table: RowTable, joint: int, rest: Array, factor: float) -> tuple[float, Array, float]:
    """Rms, autoregressive coefficients (4,) and innovation of a joint's noise, from the rest (M,) [N.m or N] of a fit.

    The factor is the rms of the noise over that of the rest, which the fit reduced.
    """
    moving, run = _in_motion(table, joint)
    parts, reversal_std = _split(rest[moving], run), _split(table.reversal_std[moving, joint], run)
    return _fit(parts, factor, _reliable(parts, reversal_std, float(table.scale[joint])))


def _reliable(rest: Sequence[Array], reversal_std: Sequence[Array], scale: float) -> list[Mask]:
    """For each run, rows that are neither near a reversal nor outliers; all rows if these are too few."""
    far = tuned.OUTLIER_RATIO * float(np.median(np.abs(np.concatenate(rest)))) or np.inf
    reliable = [(u < tuned.RELIABLE_STD * scale) & (np.abs(x) < far) for x, u in zip(rest, reversal_std, strict=True)]
    if np.concatenate(reliable).mean() < tuned.MIN_RELIABLE_SHARE:
        reliable = [np.ones(len(x), dtype=bool) for x in reversal_std]
    return reliable


def _reversal_scale(rest: Array, reversal_std: Array, floor: float) -> float:
    """Scale of the reversal uncertainty, from residuals near reversals [1]."""
    near = reversal_std > floor
    if near.sum() < MIN_REVERSAL_ROWS:
        return tuned.REVERSAL_SCALES[0]
    typical = [
        np.median(rest[near] ** 2 / (floor**2 + (scale * reversal_std[near]) ** 2)) for scale in tuned.REVERSAL_SCALES
    ]
    wide = (scale for scale, x in zip(tuned.REVERSAL_SCALES, typical, strict=True) if x <= CHI2_MEDIAN)
    return next(wide, tuned.REVERSAL_SCALES[-1])


def _saturated(table: RowTable, joint: int, used: Mask) -> tuple[list[Array], list[Array], float]:
    """For each run, the residual of a fit of all columns and the reversal std; and the correction of its rms [1]."""
    moving, run = _in_motion(table, joint)
    x, y = table.columns[joint][:, used[table.place[joint]]][moving], table.residual[moving, joint]
    size = np.nan_to_num(np.sqrt(np.mean(x**2, axis=0)), posinf=0.0)
    shown = size > 1e-9 * size.max(initial=1e-300)
    x = x[:, shown] / size[shown]
    left, singular, _ = np.linalg.svd(x, full_matrices=False)
    left = left[:, singular > COLUMN_RANK_TOLERANCE * singular.max(initial=0.0)]
    left = left[:, : max(1, int(len(y) / tuned.ROWS_PER_DIRECTION))]
    parts = [(part, find_wave(part, 1.0)) for part in _split(y - left @ (left.T @ y), run)]
    rest = [part - wave.signal if wave.share > tuned.WAVE_SHARE else part for part, wave in parts]
    return rest, _split(table.reversal_std[moving, joint], run), float(np.sqrt(len(y) / max(len(y) - left.shape[1], 1)))


def _columns_in_fit(table: RowTable) -> Mask:
    """(p,) columns of the saturated fit: some shapes of each hypothesis, none that is made of recorded torque."""
    seen, kept = dict[object, int](), np.zeros(table.count, dtype=bool)
    for group in table.groups:
        key = None if group.hypothesis is None else group.hypothesis.key
        seen[key] = seen.get(key, 0) + 1
        laws = () if group.hypothesis is None else group.hypothesis.laws
        measured = any(isinstance(law.effect, ActuatorLaw) for law in laws)
        kept[group.start : group.start + group.size] = not measured and (
            key is None or seen[key] <= tuned.SHAPES_IN_FIT
        )
    return kept


def _replicates(table: RowTable, joint: int, periods: Sequence[float | None], rate: float) -> list[Array]:
    """Stretches of the difference between consecutive periods over sqrt(2), without the loudest."""
    out = list[Array]()
    for k in np.unique(table.piece):
        rows = np.flatnonzero(table.piece == k)
        period = periods[int(table.recording[rows[0]])]
        lag = 0 if period is None else round(period * rate)
        if lag and len(rows) >= lag + 4 * tuned.AR_ORDER:
            y = np.where(table.at_rest[rows, joint], 0.0, table.residual[rows, joint])
            count = min(tuned.REPLICATE_STRETCHES, (len(y) - lag) // (4 * tuned.AR_ORDER))
            out.extend(np.array_split((y[:-lag] - y[lag:]) / np.sqrt(2), count))
    if not out:
        return []
    power = np.array([np.mean(x**2) for x in out])
    return [x for x, size in zip(out, power, strict=True) if size <= np.quantile(power, tuned.KEPT_STRETCH_SHARE)]


def _fit(pieces: Sequence[Array], factor: float, reliable: Sequence[Mask]) -> tuple[float, Array, float]:
    """Rms, coefficients and innovation from rows whose whole window is reliable; white noise if these are too few."""
    size, long = (
        tuned.AR_ORDER + 1,
        [(x, y) for x, y in zip(pieces, reliable, strict=True) if len(x) > 2 * tuned.AR_ORDER],
    )
    windows = [sliding_window_view(x, size)[sliding_window_view(y, size).all(axis=1)] for x, y in long]
    rows = np.concatenate([np.empty((0, size)), *windows])
    before, after = rows[:, tuned.AR_ORDER - 1 :: -1], rows[:, tuned.AR_ORDER]
    floor = float(np.sqrt(np.mean(np.concatenate([x[k] for x, k in zip(pieces, reliable, strict=True)]) ** 2)))
    coefficients, new = np.zeros(tuned.AR_ORDER), floor
    if len(rows) >= 4 * tuned.AR_ORDER:
        coefficients = _damped(least_squares(before, after))
        new = float(np.std(after - before @ coefficients))
    least = 1e-9 * max(floor, 1e-300) + 1e-12
    return factor * floor + least, coefficients, factor * new + least


def _damped(coefficients: Array) -> Array:
    """(4,) [1] autoregressive coefficients with all roots scaled such that none decays too slowly.

    Source: bandwidth expansion, e.g. Markel, Gray, Linear Prediction of Speech, 1976.
    """
    slowest = float(np.max(np.abs(np.roots(np.append(1.0, -coefficients))), initial=0.0))
    return np.asarray(
        coefficients * min(1.0, tuned.MAX_AR_ROOT / max(slowest, tuned.MAX_AR_ROOT)) ** np.arange(1, tuned.AR_ORDER + 1)
    )


def _in_motion(table: RowTable, joint: int) -> tuple[Mask, Indices]:
    """Rows in motion (M,), all if these are too few, and the run (M',) of each; a run is within one piece."""
    moving = ~table.at_rest[:, joint]
    moving = moving if moving.sum() > tuned.MIN_MOVING_ROWS else np.ones_like(moving)
    starts = (np.diff(table.piece, prepend=-1) != 0) | (np.diff(moving.astype(np.intp), prepend=0) != 0)
    return moving, np.cumsum(starts)[moving]


def _split(x: Array, piece: Indices) -> list[Array]:
    return [x[piece == k] for k in np.unique(piece)]
