"""Samples on the uniform grid of a span, bitwise independent of the requested range."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...types import Array, Recording, Samples
from .stretch import STRIDE, Sampling, Span, Stretch


def samples(recording: Recording, sampling: Sampling, span: Span, start: int, stop: int) -> Samples:
    """Read samples start..stop of the uniform grid of a span; only the required rows of the file are read.

    For uniform sampling, the samples are the rows without duplicates, at the ideal times of the grid. Otherwise signals
    are interpolated by cubic Hermite splines with the slopes of parabolas through three neighbours (Catmull-Rom on
    nonuniform stamps). Absolute torques are interpolated linearly, so that they remain nonnegative.

    Source: Catmull, Rom, A class of local interpolating splines, 1974; de Boor, A Practical Guide to Splines, 1978,
    chapter IV (Bessel slopes).
    """
    stretch = sampling.stretch(span)
    low, high = stretch.first + start, stretch.first + min(stop, stretch.count)
    t = stretch.stamps[0] + np.arange(low, high) * sampling.period
    if not len(t):
        return _rows(recording, sampling, stretch, 0, 0)
    if sampling.uniform:
        return _rows(recording, sampling, stretch, low, high)._replace(t=t)
    blocks = np.searchsorted(stretch.stamps, t[[0, -1]], side="right") - 1
    first, last = max(0, blocks[0] * STRIDE - 1), min(stretch.kept, (blocks[1] + 1) * STRIDE + 2)
    return _interpolate(_rows(recording, sampling, stretch, first, last), t, ~recording.signed)


def _rows(recording: Recording, sampling: Sampling, stretch: Stretch, low: int, high: int) -> Samples:
    """Kept rows low..high of a stretch, with unwrapped angles."""
    ends = np.searchsorted(sampling.dropped, [stretch.start, stretch.stop])
    dropped = sampling.dropped[slice(*ends)] - stretch.start
    place = dropped - np.arange(len(dropped))  # number of kept rows before each dropped one
    begin, end = (stretch.start + k + int(np.searchsorted(place, k, side="right")) for k in (low, high - 1))
    end = end + 1 if high > low else begin
    found = recording.read(begin, end)
    inside = dropped[slice(*np.searchsorted(dropped + stretch.start, [begin, end]))] + stretch.start - begin
    if len(inside):
        found = Samples._make(x if x is None else np.delete(x, inside, axis=0) for x in found)
    if len(sampling.turn_rows):
        rows = np.delete(np.arange(begin, end), inside)
        turns = _turns(sampling, rows) - _turns(sampling, np.array([stretch.start]))
        found = _unwrap(found, turns, np.asarray(sampling.turns.any(axis=0)))
    return found


def _turns(sampling: Sampling, rows: NDArray[np.intp]) -> Array:
    """Full turns (len(rows), n) to be added at some rows."""
    n = sampling.turns.shape[1]
    count = np.searchsorted(sampling.turn_rows, rows, side="right")
    return np.concatenate([np.zeros((1, n)), sampling.turns])[count]


def _unwrap(found: Samples, turns: Array, wraps: NDArray[np.bool_]) -> Samples:
    """Add full turns to positions; shift desired positions of wrapping joints by full turns to the nearest value."""
    q = found.q + 2 * np.pi * turns
    if found.q_des is None:
        return found._replace(q=q)
    nearest = found.q_des + 2 * np.pi * np.round((q - found.q_des) / (2 * np.pi))
    return found._replace(q=q, q_des=np.where(wraps, nearest, found.q_des))


def _interpolate(rows: Samples, t: Array, unsigned: NDArray[np.bool_]) -> Samples:
    signals = [x for x in rows[1:] if x is not None]
    n = rows.q.shape[1]
    linear = np.zeros(n * len(signals), bool)
    linear[n : 2 * n] = unsigned
    values = _hermite(rows.t, np.concatenate(signals, axis=1), t, linear)
    parts = iter(np.split(values, len(signals), axis=1))
    return Samples._make([t, *(None if x is None else next(parts) for x in rows[1:])])


def _hermite(stamps: Array, y: Array, t: Array, linear: NDArray[np.bool_]) -> Array:
    """Interpolated values (M, c) at the times t (M,) of signals y (N, c) at the stamps (N,); N > 2."""
    h = np.diff(stamps)[:, None]
    chord = np.diff(y, axis=0) / h
    slope = np.empty_like(y)
    slope[1:-1] = (h[1:] * chord[:-1] + h[:-1] * chord[1:]) / (h[:-1] + h[1:])
    slope[0] = chord[0] + (chord[0] - chord[1]) * (h[0] / (h[0] + h[1]))
    slope[-1] = chord[-1] + (chord[-1] - chord[-2]) * (h[-1] / (h[-1] + h[-2]))
    i = np.clip(np.searchsorted(stamps, t, side="right") - 1, 0, len(stamps) - 2)
    after = (t - stamps[i])[:, None]
    u = after / h[i]
    d, s, e = chord[i], slope[i], slope[i + 1]
    smooth = y[i] + after * (s + u * ((3 * d - 2 * s - e) + u * (s + e - 2 * d)))
    if not linear.any():
        return smooth
    straight = np.maximum(y[i] + after * d, 0.0)
    return np.where(linear, straight, smooth)
