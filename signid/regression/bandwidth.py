"""Filters, and the cut-offs chosen from encoder noise and the bandwidth of the motion."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, comb
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..types import Array, Frozen, Mask, Samples

Value = TypeVar("Value", bound=np.generic)
FIRST_DIFFERENCE = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
SECOND_DIFFERENCE = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
DIFFERENCE_REACH = 4  # samples that a difference needs on either side
ATTENUATION = 60.0  # [dB] of the stop band of a low-pass; Kaiser's formulas hold from 50 on
MIN_SEGMENT_SAMPLES = 64  # smallest number of samples of a segment in `Decimator`, unless the filter is shorter
HALF_POWER_RATIO = 1.06  # [1] half-amplitude frequency of the low-pass over its half-power frequency
MAX_NOISE_SHARE = 1e-3  # [1] largest noise power of the acceleration below the cut-off, over its signal power
MIN_CUTOFF_SAMPLES = 6  # smallest number of samples per period of the cut-off
MOTION_POWER_SHARE = 0.95  # [1] share of the acceleration's power that defines the highest frequency of the motion
MAX_CUTOFF_RATIO = 3.0  # [1] largest cut-off over that frequency
CUTOFF_TOLERANCE, FAST_CUTOFF_TOLERANCE, FAST_RATE = 0.01, 0.04, 2000.0  # [1], above FAST_RATE [Hz]
TARGET_RATE, POSITION_SAMPLES = 250.0, 3.0  # [Hz] sufficient; at least, per period of the position cut-off
DIFF_ORDER = 6  # order of the differences that estimate encoder noise
DESIRED_CUTOFF = 5.0  # [Hz] smallest cut-off that is aimed at, if noise allows


def lowpass(rate: float, cutoff: float) -> Array:
    """Taps of a symmetric Kaiser low-pass with pass band up to 0.75 cutoff and stop band from 1.25 cutoff on.

    The odd number of taps (k,) [1] sum to 1. The cut-off is the frequency of half amplitude [Hz]; from 0.4 of the
    sampling rate on there is no filter.

    Source: Kaiser, Nonrecursive digital filter design using the I0-sinh window function, IEEE ISCAS 1974. Own code,
    since importing scipy.signal takes longer than most identifications.
    """
    if cutoff >= 0.4 * rate:
        return np.ones(1)
    count = int(np.ceil((ATTENUATION - 7.95) / (2.285 * np.pi * cutoff / rate) + 1)) | 1
    taps = np.sinc(2 * cutoff / rate * (np.arange(count) - count // 2)) * np.kaiser(count, 0.1102 * (ATTENUATION - 8.7))
    return np.asarray(taps / taps.sum())


def smooth(signal: Array, taps: Array, whole: bool = False) -> Array:
    """Filtered signal (N, c) [any unit] where symmetric taps (k,) [1] overlap it fully, (N - k + 1, c).

    The `whole` result has all N samples; the signal is continued by its first and last values.
    """
    if whole:
        signal = np.pad(signal, ((len(taps) // 2,) * 2, (0, 0)), mode="edge")
    return signal if len(taps) == 1 else _correlate(signal, taps)


def differentiate(signal: Array, period: float) -> tuple[Array, Array]:
    """First and second derivatives, (N - 8, c) each, of a signal (N, c) [any unit], by nine-point central differences.

    Source: Fornberg, Mathematics of Computation 51, 1988, table 1 (eighth order).
    """
    return _correlate(signal, FIRST_DIFFERENCE / period), _correlate(signal, SECOND_DIFFERENCE / period**2)


def moving_minimum(signal: Array, half: int) -> Array:
    """Minimum (N, c) of a signal (N, c) [any unit] over `half` samples on either side; fewer at the ends.

    Equal to `scipy.ndimage.minimum_filter1d`. Importing that takes longer than most identifications.
    """
    found, width = np.pad(signal, ((half, half), (0, 0)), mode="edge"), 1
    while 2 * width <= 2 * half + 1:
        found, width = np.minimum(found[:-width], found[width:]), 2 * width
    rest = 2 * half + 1 - width
    return np.asarray(np.minimum(found[: len(found) - rest], found[rest:]))


class Decimator:
    """Symmetric low-pass evaluated at every `factor`-th sample only, for many columns at once.

    The odd number of taps is symmetric. Each segment of samples has a fixed length and is multiplied by a matrix of
    fixed shape, which gives its share of all outputs that its samples reach. So a row's value does not depend on the
    rows that are computed with it, as long as these begin at a multiple of `block` rows.
    """

    def __init__(self, taps: Array, factor: int) -> None:
        self.taps, self.factor, self.half = taps, factor, len(taps) // 2
        self._reach = -(-len(taps) // factor)  # length of the taps in outputs
        self.block = min(-(-MIN_SEGMENT_SAMPLES // factor), self._reach if len(taps) > 1 else MIN_SEGMENT_SAMPLES)
        self.segment = self.block * factor  # samples
        self._matrix = np.zeros((self.block + self._reach - 1, self.segment))
        for row in range(len(self._matrix)):  # this is output row - reach + 1, counted from the segment's first
            start = (row - self._reach + 1) * factor  # sample at which its taps begin
            low, high = max(start, 0), min(start + len(taps), self.segment)
            self._matrix[row, low:high] = taps[low - start : high - start]

    def at(self, samples: NDArray[Value]) -> NDArray[Value]:
        """The samples (N, ...) [any unit], unfiltered, on which the outputs are centred: (M, ...)."""
        return samples[self.half : len(samples) - self.half : self.factor]

    def __call__(self, columns: Array) -> Array:
        """Outputs (M, c) of columns (N, c) [any unit]; the first is centred on sample `half`."""
        starts = range(0, len(columns), self.segment)
        return self.gather((columns[k : k + self.segment] for k in starts), *columns.shape)

    def gather(self, segments: Iterable[Array], samples: int, width: int) -> Array:
        """Outputs (M, c) of N = `samples` rows of c = `width` columns, which arrive as segments (k, c) [any unit].

        The last segment may be shorter. The memory of a segment may be reused.
        """
        out = np.zeros((max(0, (samples - len(self.taps)) // self.factor + 1), width))
        for k, piece in enumerate(segments):
            start = k * self.block
            if len(self.taps) == 1:
                out[start : start + self.block] = piece[:: self.factor]
                continue
            if len(piece) < self.segment:
                piece = np.concatenate([piece, np.zeros((self.segment - len(piece), width))])
            low, high = max(start - self._reach + 1, 0), min(start + self.block, len(out))
            if low < high:
                first = low - start + self._reach - 1
                out[low:high] += (self._matrix @ piece)[first : first + high - low]
        return out


def _correlate(signal: Array, taps: Array) -> Array:
    """Correlation (N - k + 1, c) of each column with the taps; a value does not depend on its position."""
    out = np.empty((signal.shape[1], max(0, len(signal) - len(taps) + 1)))
    for row, column in zip(out, np.ascontiguousarray(signal.T), strict=True):
        if len(row):
            row[:] = np.correlate(column, taps, "valid")
    return np.ascontiguousarray(out.T)


@dataclass(frozen=True, eq=False)
class Band(Frozen):
    """Frequency band of an identification.

    Positions are low-passed at `position_cutoff`, regressor columns and torque at `cutoff`. Then every `factor`-th row
    is kept: the new Nyquist frequency is the cut-off.
    """

    rate: float  # [Hz] of the recordings on their uniform grid
    factor: int  # samples per row
    filtered: bool  # False: no filter, one row per sample
    per_joint: Array  # (n,) [Hz] highest cut-off that each joint's encoder noise allows
    velocity_noise: Array  # (n,) [rad/s or m/s] standard deviation of the differentiated positions
    torque_floor: Array  # (n,) [N.m or N] standard deviation of the white torque noise that passes the filter
    beyond: float = 3.0  # [1] position cut-off over cut-off

    @property
    def cutoff(self) -> float:
        """Half-power frequency of columns and torque [Hz]."""
        return self.rate / (2 * self.factor) if self.filtered else self.rate / 2

    @cached_property
    def taps(self) -> Array:
        """Taps (k,) [1] of the low-pass before decimation, with half power at the new Nyquist frequency.

        The spectrum that aliases then fills what the filter removes, and white noise stays white.
        """
        return lowpass(self.rate, HALF_POWER_RATIO * self.cutoff) if self.filtered else np.ones(1)

    def decimator(self, parts: int = 1) -> Decimator:
        """Low-pass and decimation for every `parts`-th sample; the rows lie at the same times for any `parts`."""
        taps = self.taps[len(self.taps) // 2 % parts :: parts]
        return Decimator(taps / taps.sum() if parts > 1 else taps, self.factor // parts)

    @cached_property
    def parts(self) -> int:
        """Decimation of the motion from which rigid-body columns are computed: positions are smooth over it."""
        return max(parts for parts in range(1, self._spare + 1) if self.factor % parts == 0)

    @property
    def _spare(self) -> int:
        """Largest factor by which the rate could be lowered without loss in the band."""
        if not self.filtered:
            return 1
        return max(1, min(round(self.rate / TARGET_RATE), int(self.rate / (POSITION_SAMPLES * self.position_cutoff))))

    @property
    def position_cutoff(self) -> float:
        """Half-amplitude frequency of positions [Hz]."""
        return self.beyond * self.cutoff

    @cached_property
    def position_taps(self) -> Array:
        """Taps (k,) [1] of the low-pass on positions."""
        return lowpass(self.rate, self.position_cutoff) if self.filtered else np.ones(1)

    def divided(self) -> Band:
        """Band of the same cut-off to 1 % (4 % above 2 kHz), whose factor has divisors for decimated columns."""
        alike = FAST_CUTOFF_TOLERANCE if self.rate > FAST_RATE else CUTOFF_TOLERANCE
        factors = (parts * round(self.factor / parts) for parts in range(self._spare, 0, -1))
        factor = next(factor for factor in factors if abs(factor - self.factor) <= alike * self.factor)
        return replace(self, factor=factor, torque_floor=self.torque_floor * np.sqrt(self.factor / factor))


def choose_band(pieces: Sequence[Samples], rate: float, cutoff: float | None = None) -> Band:
    """Band for recordings of one rate: as wide as the motion needs, if encoder noise allows it on every joint.

    A cut-off f is allowed if the noise power of the acceleration below f is at most 1e-3 of its signal power. The
    cut-off is at most three times the frequency below which 95 % of the acceleration's power lies. A given cut-off [Hz]
    is used as it is; infinite: no filter.
    """
    longest = max(len(piece.t) for piece in pieces)
    spectrum = _acceleration_spectrum([piece.q for piece in pieces if 2 * len(piece.t) >= longest], rate)
    allowed, noise = spectrum.allowed, spectrum.level
    widest = min(float(np.min(allowed)), rate / MIN_CUTOFF_SAMPLES)
    needed = max(DESIRED_CUTOFF, MAX_CUTOFF_RATIO * spectrum.content(widest))
    # white torque noise: third differences of smooth torque are small, and jumps do not change their median
    jumps = np.array([np.median(np.abs(np.diff(np.nan_to_num(x.tau), 3, axis=0)), axis=0) for x in pieces]) / 0.6745
    level = np.nanmedian(jumps**2 / 20 / (rate / 2), axis=0)  # (n,) [N2.m2/Hz], one-sided
    if cutoff is not None and np.isinf(cutoff):
        return Band(rate, 1, False, allowed, _speed_noise(noise, rate / 2), np.sqrt(level * rate / 2))
    factor = max(1, ceil(rate / (2 * (min(widest, needed) if cutoff is None else cutoff)) - 1e-9))
    speed = _speed_noise(noise, min(3 * rate / (2 * factor), rate / 2))
    return Band(rate, factor, True, allowed, speed, np.sqrt(level * rate / (2 * factor))).divided()


def encoder_noise(q: Array) -> Array:
    """Standard deviation (n,) of white noise of positions q (N, n) [rad or m], from differences of high order."""
    return np.asarray(np.sqrt(np.mean(np.diff(q, DIFF_ORDER, axis=0) ** 2, axis=0) / comb(2 * DIFF_ORDER, DIFF_ORDER)))


class _Acceleration(NamedTuple):
    """Spectrum of the second derivatives of the positions of n joints."""

    frequency: Array  # (f,) [Hz]
    power: Array  # (f, n) [rad2/s4/Hz]
    level: Array  # (n,) [rad2/Hz] one-sided spectrum of the encoder noise
    allowed: Array  # (n,) [Hz] highest cut-off that noise allows; inf for a joint at rest
    moves: Mask  # (n,) whether the joint moves

    def content(self, widest: float) -> float:
        """Frequency below which 95 % of the power up to `widest` lies, on the fastest joint [Hz]."""
        inside = np.cumsum(self.power * (self.frequency <= widest)[:, None], axis=0)[:, self.moves]
        reached = inside > MOTION_POWER_SHARE * inside[-1]
        return float(np.max(self.frequency[np.argmax(reached, axis=0)], initial=0.0))


def _power_spectrum(x: Array, rate: float, length: int) -> Array:
    """Power spectrum (f, c) of a signal (N, c): mean over Hann windows that overlap by half.

    Source: Welch, IEEE Transactions on Audio and Electroacoustics 15(2), 1967.
    """
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(length) / length)
    starts = range(0, len(x) - length + 1, length - length // 2)
    parts = (x[k : k + length] for k in starts)
    power = sum(np.abs(np.fft.rfft((part - part.mean(axis=0)) * window[:, None], axis=0)) ** 2 for part in parts)
    power = np.asarray(power) / (len(starts) * rate * (window @ window))
    power[1 : -1 if length % 2 == 0 else None] *= 2
    return power


def _acceleration_spectrum(pieces: Sequence[Array], rate: float) -> _Acceleration:
    """Mean spectrum of pieces (N, n) [rad or m], weighted by their lengths."""
    shortest, sizes = min(map(len, pieces)), np.array([len(q) for q in pieces])
    length = max(min(shortest // 3, int(8 * rate)), 16)
    spectra = np.array([_power_spectrum(np.diff(q, 2, axis=0) * rate**2, rate, length) for q in pieces])
    f: Array = np.asarray(np.fft.rfftfreq(length, 1 / rate))
    power = np.tensordot(sizes / sizes.sum(), spectra, axes=1)
    gain = (2 * rate * np.sin(np.pi * f / rate))[:, None] ** 4
    high = f > 0.3 * rate
    level = np.median(power[high] / gain[high], axis=0)
    noise = np.cumsum(level * gain, axis=0)
    signal = np.maximum(np.cumsum(power, axis=0) - noise, 1e-30)
    fits = noise <= MAX_NOISE_SHARE * signal
    last = np.maximum(len(f) - 1 - np.argmax(fits[::-1], axis=0), 1)
    moves = np.max([np.ptp(q, axis=0) for q in pieces], axis=0) > 0
    allowed = np.where(moves, f[last], np.inf)
    return _Acceleration(f, power, level, allowed, moves)


def _speed_noise(level: Array, fastest: float) -> Array:
    """Standard deviation (n,) of the velocity for white position noise that is differentiated up to a frequency."""
    return np.asarray(np.sqrt(level * (2 * np.pi) ** 2 * fastest**3 / 3))
