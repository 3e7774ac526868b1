"""Time window in which a constant force at the last link explains most of the residual."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...effects import EFFECTS
from ...types import Array, Indices, Law
from ..data.dataset import Dataset
from ..data.hypotheses import Hypothesis
from ..data.noise import has_full_window
from ..data.thresholds import CONTACT_STEP, CONTACT_TORQUE, CONTACT_WIDTHS
from ..data.whitened_rows import Whitened

CONTACT_EFFECT = "external_contact"
END_SHIFTS = np.arange(-5, 6)  # shifts of the ends of the best window in one refinement [rows]
WINDOW_REFINEMENTS = 3  # refinements of the best window
MIN_WINDOW_ROWS = 4  # shortest window [rows]: more than the three components of a force


class _Window(NamedTuple):
    """Rows from start to stop of a piece."""

    log_bayes: float  # log Bayes factor of a force in the window [-]
    start: int
    stop: int


def find_contact(dataset: Dataset, data: Whitened, residual: Array, dispersion: Array) -> Hypothesis | None:
    """Contact in the window of highest evidence over all recordings; None if no window has a Bayes factor above 1.

    Cumulative sums of the normal equations make each window cost the same. The residual (n, M) [1] is whitened and has
    the variance dispersion (n,) [1].
    """
    full = [dataset.thin(p.motion.jacobian.reshape(len(p.motion), -1)) for p in dataset.pieces]
    jacobian = np.concatenate(full).reshape(-1, 3, data.joints)  # of the last link [m/rad or 1]
    white = dataset.whitening.local({j: jacobian[:, :, j] for j in range(data.joints)})
    shape = np.stack([white[j] / np.sqrt(dispersion[j]) for j in range(data.joints)])  # (n, M, 3)
    rest = residual / np.sqrt(dispersion)[:, None]
    variance = CONTACT_TORQUE**2 / 3 / max(float(np.mean(np.sum(jacobian**2 / data.scale**2, axis=2))), 1e-300)
    order = dataset.noise.coefficients.shape[1]
    alive = np.flatnonzero(has_full_window(dataset.table.piece, order)) + order
    rate, best = dataset.task.band.rate / dataset.task.band.factor, _Window(0.0, 0, 0)
    for k in np.unique(dataset.table.piece[alive]):
        own = np.flatnonzero(dataset.table.piece[alive] == k)
        x, y = shape[:, own], rest[:, own]
        square = np.concatenate([np.zeros((1, 3, 3)), np.cumsum(np.einsum("jti,jtk->tik", x, x), axis=0)])
        right = np.concatenate([np.zeros((1, 3)), np.cumsum(np.einsum("jti,jt->ti", x, y), axis=0)])
        window = _best(square, right, variance, rate)
        if window.log_bayes > best.log_bayes:
            first, last = alive[own[window.start]], alive[own[window.stop - 1]]
            best = _Window(window.log_bayes, int(first), int(last))
    if best.log_bayes <= 0:
        return None
    span = {"start": float(dataset.table.t[best.start]), "end": float(dataset.table.t[best.stop])}
    return Hypothesis((Law(EFFECTS[CONTACT_EFFECT], tuple(range(data.joints)), span),))


def _best(square: Array, right: Array, variance: float, rate: float) -> _Window:
    """Search the windows of one piece by cumulative sums: a grid first, then shifts of both ends of the best."""
    count, best = len(square) - 1, _Window(0.0, 0, 0)
    for width in CONTACT_WIDTHS:
        length = int(width * rate)
        start = np.arange(0, count - length, max(1, int(CONTACT_STEP * rate)))
        best = _better(best, square, right, variance, start, start + length)
    for _ in range(WINDOW_REFINEMENTS if best.stop else 0):
        low, high = (grid.ravel() for grid in np.meshgrid(best.start + END_SHIFTS, best.stop + END_SHIFTS))
        fits = (low >= 0) & (low + MIN_WINDOW_ROWS <= high) & (high <= count)
        best = _better(best, square, right, variance, low[fits], high[fits])
    return best


def _better(best: _Window, square: Array, right: Array, variance: float, start: Indices, stop: Indices) -> _Window:
    """Best of some windows and the one before, by the log Bayes factor of a force with a Gaussian prior."""
    if not len(start):
        return best
    a, b = np.eye(3) + variance * (square[stop] - square[start]), right[stop] - right[start]
    gain = variance * np.einsum("ki,ki->k", b, np.linalg.solve(a, b[..., None])[..., 0]) / 2
    gain = gain - np.linalg.slogdet(a)[1] / 2
    k = int(np.argmax(gain))
    return _Window(float(gain[k]), int(start[k]), int(stop[k])) if gain[k] > best.log_bayes else best
