"""Noise model of each joint, estimated from residuals: autoregressive, with uncertain times of reversals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ...effects.base import ActuatorLaw
from ...regression.bandwidth import Band
from ...regression.factors import Misfit
from ...regression.projection import least_squares
from ...types import Array, Frozen, Indices, Mask
from .locate import find_wave
from .rows import RowTable
from .thresholds import (
    AR_ORDER,
    KEPT_STRETCH_SHARE,
    MAX_AR_ROOT,
    MIN_MOVING_ROWS,
    MIN_RELIABLE_SHARE,
    OUTLIER_RATIO,
    PERIOD_TOLERANCE,
    RELIABLE_STD,
    REPLICATE_FACTOR,
    REPLICATE_STRETCHES,
    REVERSAL_SCALES,
    ROWS_PER_DIRECTION,
    SHAPES_IN_FIT,
    WAVE_SHARE,
)

MIN_PERIOD = 1.0  # [s] shortest period of a motion. Heuristic
MAX_PERIOD_SHARE = 0.55  # [1] longest period, as a share of the recording: nearly two periods are compared. Heuristic
COLUMN_RANK_TOLERANCE = 1e-4  # [1] smallest singular value that counts, over the largest, of scaled columns. Heuristic
MIN_REVERSAL_ROWS = 6  # rows near reversals; with fewer, the scale is not estimated. Heuristic
CHI2_MEDIAN = 0.455  # [1] median of the chi-squared distribution with one degree of freedom


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
    found = [_of_joint(table, j, used, periods, rate) for j in range(table.joints)]
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
    good = lows[apart[lows] < PERIOD_TOLERANCE]
    return float((good[0] + least) / rate) if len(good) else None


def whiten(x: Array, coefficients: Array, innovation: float, piece: Indices) -> Array:
    """(M', c) [1] rows x (M, c) [N.m or N] after a filter: coefficients (4,) [1]; each piece (M,) loses four rows."""
    order = len(coefficients)
    out = x[order:] - sum(c * x[order - 1 - k : len(x) - 1 - k] for k, c in enumerate(coefficients))
    return np.asarray(out[has_full_window(piece, order)] / innovation)


def has_full_window(piece: Indices, order: int) -> Mask:
    """(M - order,) whether the `order` rows before a row are of the same piece (M,), from the `order`-th row on."""
    return np.asarray(piece[order:] == piece[:-order])


def _of_joint(
    table: RowTable, joint: int, used: Mask, periods: Sequence[float | None], rate: float
) -> tuple[float, Array, float, float]:
    rest, reversal_std, factor = _saturated(table, joint, used)
    choices = [_fit(rest, factor, _reliable(rest, reversal_std, float(table.scale[joint])))]
    if again := _replicates(table, joint, periods, rate):
        choices.append(_fit(again, REPLICATE_FACTOR, [np.ones(len(x), dtype=bool) for x in again]))
    best = min(choices, key=lambda choice: choice[0])
    return *best, _reversal_scale(factor * np.concatenate(rest), np.concatenate(reversal_std), best[0])


def noise_of_rest(table: RowTable, joint: int, rest: Array, factor: float) -> tuple[float, Array, float]:
    """Rms, autoregressive coefficients (4,) and innovation of a joint's noise, from the rest (M,) [N.m or N] of a fit.

    The factor is the rms of the noise over that of the rest, which the fit reduced.
    """
    moving, run = _in_motion(table, joint)
    parts, reversal_std = _split(rest[moving], run), _split(table.reversal_std[moving, joint], run)
    return _fit(parts, factor, _reliable(parts, reversal_std, float(table.scale[joint])))


def _reliable(rest: Sequence[Array], reversal_std: Sequence[Array], scale: float) -> list[Mask]:
    """For each run, rows that are neither near a reversal nor outliers; all rows if these are too few."""
    far = OUTLIER_RATIO * float(np.median(np.abs(np.concatenate(rest)))) or np.inf
    reliable = [(u < RELIABLE_STD * scale) & (np.abs(x) < far) for x, u in zip(rest, reversal_std, strict=True)]
    if np.concatenate(reliable).mean() < MIN_RELIABLE_SHARE:
        reliable = [np.ones(len(x), dtype=bool) for x in reversal_std]
    return reliable


def _reversal_scale(rest: Array, reversal_std: Array, floor: float) -> float:
    """Scale of the reversal uncertainty, from residuals near reversals [1]."""
    near = reversal_std > floor
    if near.sum() < MIN_REVERSAL_ROWS:
        return REVERSAL_SCALES[0]
    typical = [np.median(rest[near] ** 2 / (floor**2 + (scale * reversal_std[near]) ** 2)) for scale in REVERSAL_SCALES]
    wide = (scale for scale, x in zip(REVERSAL_SCALES, typical, strict=True) if x <= CHI2_MEDIAN)
    return next(wide, REVERSAL_SCALES[-1])


def _saturated(table: RowTable, joint: int, used: Mask) -> tuple[list[Array], list[Array], float]:
    """For each run, the residual of a fit of all columns and the reversal std; and the correction of its rms [1]."""
    moving, run = _in_motion(table, joint)
    x, y = table.columns[joint][:, used[table.place[joint]]][moving], table.residual[moving, joint]
    size = np.nan_to_num(np.sqrt(np.mean(x**2, axis=0)), posinf=0.0)
    shown = size > 1e-9 * size.max(initial=1e-300)
    x = x[:, shown] / size[shown]
    left, singular, _ = np.linalg.svd(x, full_matrices=False)
    left = left[:, singular > COLUMN_RANK_TOLERANCE * singular.max(initial=0.0)]
    left = left[:, : max(1, int(len(y) / ROWS_PER_DIRECTION))]
    parts = [(part, find_wave(part, 1.0)) for part in _split(y - left @ (left.T @ y), run)]
    rest = [part - wave.signal if wave.share > WAVE_SHARE else part for part, wave in parts]
    return rest, _split(table.reversal_std[moving, joint], run), float(np.sqrt(len(y) / max(len(y) - left.shape[1], 1)))


def _columns_in_fit(table: RowTable) -> Mask:
    """(p,) columns of the saturated fit: some shapes of each hypothesis, none that is made of recorded torque."""
    seen, kept = dict[object, int](), np.zeros(table.count, dtype=bool)
    for group in table.groups:
        key = None if group.hypothesis is None else group.hypothesis.key
        seen[key] = seen.get(key, 0) + 1
        laws = () if group.hypothesis is None else group.hypothesis.laws
        measured = any(isinstance(law.effect, ActuatorLaw) for law in laws)
        kept[group.start : group.start + group.size] = not measured and (key is None or seen[key] <= SHAPES_IN_FIT)
    return kept


def _replicates(table: RowTable, joint: int, periods: Sequence[float | None], rate: float) -> list[Array]:
    """Stretches of the difference between consecutive periods over sqrt(2), without the loudest."""
    out = list[Array]()
    for k in np.unique(table.piece):
        rows = np.flatnonzero(table.piece == k)
        period = periods[int(table.recording[rows[0]])]
        lag = 0 if period is None else round(period * rate)
        if lag and len(rows) >= lag + 4 * AR_ORDER:
            y = np.where(table.at_rest[rows, joint], 0.0, table.residual[rows, joint])
            count = min(REPLICATE_STRETCHES, (len(y) - lag) // (4 * AR_ORDER))
            out.extend(np.array_split((y[:-lag] - y[lag:]) / np.sqrt(2), count))
    if not out:
        return []
    power = np.array([np.mean(x**2) for x in out])
    return [x for x, size in zip(out, power, strict=True) if size <= np.quantile(power, KEPT_STRETCH_SHARE)]


def _fit(pieces: Sequence[Array], factor: float, reliable: Sequence[Mask]) -> tuple[float, Array, float]:
    """Rms, coefficients and innovation from rows whose whole window is reliable; white noise if these are too few."""
    size, long = AR_ORDER + 1, [(x, y) for x, y in zip(pieces, reliable, strict=True) if len(x) > 2 * AR_ORDER]
    windows = [sliding_window_view(x, size)[sliding_window_view(y, size).all(axis=1)] for x, y in long]
    rows = np.concatenate([np.empty((0, size)), *windows])
    before, after = rows[:, AR_ORDER - 1 :: -1], rows[:, AR_ORDER]
    floor = float(np.sqrt(np.mean(np.concatenate([x[k] for x, k in zip(pieces, reliable, strict=True)]) ** 2)))
    coefficients, new = np.zeros(AR_ORDER), floor
    if len(rows) >= 4 * AR_ORDER:
        coefficients = _damped(least_squares(before, after))
        new = float(np.std(after - before @ coefficients))
    least = 1e-9 * max(floor, 1e-300) + 1e-12
    return factor * floor + least, coefficients, factor * new + least


def _damped(coefficients: Array) -> Array:
    """(4,) [1] autoregressive coefficients with all roots scaled such that none decays too slowly.

    Source: bandwidth expansion, e.g. Markel, Gray, Linear Prediction of Speech, 1976.
    """
    slowest = float(np.max(np.abs(np.roots(np.append(1.0, -coefficients))), initial=0.0))
    return np.asarray(coefficients * min(1.0, MAX_AR_ROOT / max(slowest, MAX_AR_ROOT)) ** np.arange(1, AR_ORDER + 1))


def _in_motion(table: RowTable, joint: int) -> tuple[Mask, Indices]:
    """Rows in motion (M,), all if these are too few, and the run (M',) of each; a run is within one piece."""
    moving = ~table.at_rest[:, joint]
    moving = moving if moving.sum() > MIN_MOVING_ROWS else np.ones_like(moving)
    starts = (np.diff(table.piece, prepend=-1) != 0) | (np.diff(moving.astype(np.intp), prepend=0) != 0)
    return moving, np.cumsum(starts)[moving]


def _split(x: Array, piece: Indices) -> list[Array]:
    return [x[piece == k] for k in np.unique(piece)]
