"""Residual -> the window in which a force at the last link explains most of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...effects import EFFECTS
from ...types import Array, Indices, Law
from ..data.dataset import Dataset
from ..data.hypotheses import Hypothesis
from ..data.noise import has_full_window
from ..data.whitened_rows import Whitened

NAME = "external_contact"
WIDTHS = (0.5, 0.9, 1.5, 2.5, 4.0, 7.0)  # [s] of the windows tried first
STEP = 0.2  # [s] between them
MOVES = np.arange(-5, 6)  # rows by which the ends of the best window are moved, again and again
ROUNDS = 3
SIZE = 0.15  # of the force's torque beforehand, as a share of torque


class _Window(NamedTuple):
    gain: float
    piece: int
    start: int
    stop: int


def find_contact(dataset: Dataset, data: Whitened, residual: Array, dispersion: Array) -> Hypothesis | None:
    """The likeliest window of all recordings, None where none is better than nothing.

    Sums up to every row make each window cost the same.

    Args:
        dataset: gives the motions.
        data: whitened rows.
        residual: (n, M) whitened, after all that is selected [1].
        dispersion: (n,) its variance [1].
    """
    jacobian = _jacobian(dataset)
    white = dataset.whitening.local({j: jacobian[:, :, j] for j in range(data.joints)})
    shape = np.stack([white[j] / np.sqrt(dispersion[j]) for j in range(data.joints)])  # (n, M, 3)
    rest = residual / np.sqrt(dispersion)[:, None]
    variance = SIZE**2 / 3 / max(float(np.mean(np.sum(jacobian**2 / data.scale**2, axis=2))), 1e-300)
    order = dataset.noise.coefficients.shape[1]
    alive = np.flatnonzero(has_full_window(dataset.table.piece, order)) + order
    rate, best = dataset.task.band.rate / dataset.task.band.factor, _Window(0.0, 0, 0, 0)
    for k in np.unique(dataset.table.piece[alive]):
        own = np.flatnonzero(dataset.table.piece[alive] == k)
        x, y = shape[:, own], rest[:, own]
        square = np.concatenate([np.zeros((1, 3, 3)), np.cumsum(np.einsum("jti,jtk->tik", x, x), axis=0)])
        right = np.concatenate([np.zeros((1, 3)), np.cumsum(np.einsum("jti,jt->ti", x, y), axis=0)])
        found = _best(square, right, variance, rate)
        if found.gain > best.gain:
            first, last = alive[own[found.start]], alive[own[found.stop - 1]]
            best = _Window(found.gain, int(k), int(first), int(last))
    if best.gain <= 0:
        return None
    span = {"start": float(dataset.table.t[best.start]), "end": float(dataset.table.t[best.stop])}
    return Hypothesis((Law(EFFECTS[NAME], tuple(range(data.joints)), span),))


def _jacobian(dataset: Dataset) -> Array:
    """(M, 3, n) [m/rad or 1]."""
    n = dataset.table.joints
    full = [piece.motion.jacobian.reshape(len(piece.motion), -1) for piece in dataset.pieces]
    return np.concatenate([dataset.thin(x) for x in full]).reshape(-1, 3, n)


def _best(square: Array, right: Array, variance: float, rate: float) -> _Window:
    count, best = len(square) - 1, _Window(0.0, 0, 0, 0)
    for width in WIDTHS:
        length = int(width * rate)
        start = np.arange(0, count - length, max(1, int(STEP * rate)))
        best = _better(best, square, right, variance, start, start + length)
    for _ in range(ROUNDS if best.stop else 0):
        low, high = (grid.ravel() for grid in np.meshgrid(best.start + MOVES, best.stop + MOVES))
        fits = (low >= 0) & (low + 4 <= high) & (high <= count)
        best = _better(best, square, right, variance, low[fits], high[fits])
    return best


def _better(best: _Window, square: Array, right: Array, variance: float, start: Indices, stop: Indices) -> _Window:
    """The best of some windows, or the one before; log Bayes factors of a force of unknown direction."""
    if not len(start):
        return best
    a, b = np.eye(3) + variance * (square[stop] - square[start]), right[stop] - right[start]
    gain = variance * np.einsum("ki,ki->k", b, np.linalg.solve(a, b[..., None])[..., 0]) / 2
    gain = gain - np.linalg.slogdet(a)[1] / 2
    k = int(np.argmax(gain))
    return _Window(float(gain[k]), 0, int(start[k]), int(stop[k])) if gain[k] > best.gain else best
