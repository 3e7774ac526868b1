"""Generalised total least squares: the bias by position noise in the regressor columns is removed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.linalg

from ...regression.bandwidth import encoder_noise
from ...regression.rows import read_rows
from ...regression.session import BAND_SAMPLES, longest_piece
from ...types import Array, Estimate
from ..least_squares import estimate
from . import Estimator, Given, part_of

NOISE_SEED, NOISE_DRAWS = 0, 4  # seed of the simulated position noise, and number of realisations
MAX_COLUMN_NOISE = 0.5  # [1] largest noise share of the power of a combination of columns without a flag


class TotalLeastSquares(Estimator):
    """Normal equations (G - C) beta = g with the Gram matrix C of the noise in the columns.

    C is computed numerically: white noise of the encoders' standard deviation is added to the positions, and all
    columns are recomputed. Since C is known, not only its direction, total least squares reduces to these equations.
    """

    name, title = "tls", "total least squares"
    source = "Van Huffel, Vandewalle, The Total Least Squares Problem, SIAM 1991, chapter 10"

    def estimate(self, given: Given) -> Estimate:
        """Estimate with a note on the noise share of the columns, and a flag if it is large."""
        grams, sizes = column_noise(given)
        found = estimate(given.factors, given.base, given.prior, given.whiten, grams)
        share = _largest_share(given, grams, found.noise)
        listed = ", ".join(f"{size:.2g}" for size in sizes)
        note = f"encoder noise of {listed} rad or m was removed from the columns: up to {share:.1%} of their power"
        flag = f"position noise is {share:.0%} of the power of some columns, and the estimate is uncertain; lower the "
        flags = (flag + "cut-off",) if share > MAX_COLUMN_NOISE else ()
        return replace(found, method=self.title, notes=(*found.notes, note), flags=flags)


def column_noise(given: Given) -> tuple[list[Array], Array]:
    """Gram matrix (m, m) of the noise in each joint's columns, and standard deviations (n,) of positions [rad or m]."""
    session = given.session
    pieces = [longest_piece(part, BAND_SAMPLES) for part in session.train]
    size = encoder_noise(max((piece.q for piece in pieces), key=len))
    task, rng = replace(session.task, instruments=False), np.random.default_rng(NOISE_SEED)
    grams = [np.zeros((len(seen), len(seen))) for seen in given.factors.columns]
    rows = np.zeros(len(grams))
    for piece in [piece for piece in pieces for _ in range(NOISE_DRAWS)]:
        noisy = piece._replace(q=piece.q + size * rng.standard_normal(piece.q.shape))
        both = (read_rows(task, *part_of(session, samples)) for samples in (piece, noisy))
        for ours, theirs in zip(*both, strict=True):
            for j, gram in enumerate(grams):
                keep = ours.steady[:, j] & theirs.steady[:, j] & ours.recorded[j]
                change = (theirs.columns[j] - ours.columns[j])[keep]
                gram += change.T @ change
                rows[j] += len(change)
    counts = np.array([joint.counts[0] for joint in given.factors.joints])
    scale = counts / np.maximum(rows, 1)
    return [gram * s for gram, s in zip(grams, scale, strict=True)], size


def _largest_share(given: Given, noise_grams: Sequence[Array], noise: Array) -> float:
    """Largest noise share of the power of a combination of columns, over the identifiable combinations."""
    b = given.base.rank
    whole, added = np.zeros((2, b, b))
    for joint, seen, own, sigma in zip(given.factors.joints, given.factors.columns, noise_grams, noise, strict=True):
        at = np.ix_(seen, seen)
        gram = joint.grams[0][-len(seen) - 1 : -1, -len(seen) - 1 : -1]
        whole[at] += gram / sigma**2
        added[at] += own / sigma**2
    size = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    unit = whole / np.outer(size, size) + 1e-9 * np.eye(b)
    return float(scipy.linalg.eigh(added / np.outer(size, size), unit, eigvals_only=True)[-1])


PLUGIN = TotalLeastSquares()
