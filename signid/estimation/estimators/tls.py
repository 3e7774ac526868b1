"""Generalised total least squares: what noise of the positions adds to the columns is taken away."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy.linalg

from ...regression.bandwidth import encoder_noise
from ...regression.rows import Rows, Task, read_rows
from ...regression.session import PIECE, Session, longest_piece
from ...types import Array, Estimate, Samples
from ..least_squares import estimate
from .base import Estimator, Given
from .part import part_of

SEED, DRAWS = 0, 4  # of the noise that is added to see what it does
MOST = 0.5  # share of a column combination's power that may be noise


class TotalLeastSquares(Estimator):
    """Noise in columns and torque: (G - C) beta = g, C the Gram matrix of the columns' own noise.

    C is found numerically: white noise of the size of the encoders' is added to the positions, and all columns are
    built anew. As C is known and not only its direction, the smallest generalised eigenvalue of total least squares is
    1 for the torque noise that is found beside, and its solution is that of these normal equations.
    """

    name, title = "tls", "total least squares"
    source = "Van Huffel, Vandewalle, The Total Least Squares Problem, SIAM 1991, chapter 10"

    def estimate(self, given: Given) -> Estimate:
        """Of the rows as they are; flagged where noise is most of what the columns hold."""
        spoilt, sizes = column_noise(given)
        found = estimate(given.factors, given.base, given.prior, given.whiten, spoilt)
        share = _largest_share(given, spoilt, found.noise)
        told = ", ".join(f"{size:.2g}" for size in sizes)
        note = f"encoder noise of {told} rad or m was taken from the columns: up to {share:.1%} of their power"
        flag = f"noise of the positions makes up {share:.0%} of what some columns hold: lower the cut-off for total "
        flags = (flag + "least squares",) if share > MOST else ()
        return replace(found, method=self.title, notes=(*found.notes, note), flags=flags)


def column_noise(given: Given) -> tuple[list[Array], Array]:
    """What noise of the positions adds to each joint's Gram matrix of columns, and the size of that noise.

    Args:
        given: the session and its factors.

    Returns:
        Per joint (m, m) [products of the units of the columns], and (n,) [rad or m].
    """
    session = given.session
    pieces = [longest_piece(part, PIECE) for part in session.train]
    size = encoder_noise(max((piece.q for piece in pieces), key=len))
    task, rng = replace(session.task, instruments=False), np.random.default_rng(SEED)
    grams = [np.zeros((len(seen), len(seen))) for seen in given.factors.columns]
    rows = np.zeros(len(grams))
    for piece in [piece for piece in pieces for _ in range(DRAWS)]:
        noisy = piece._replace(q=piece.q + size * rng.standard_normal(piece.q.shape))
        for ours, theirs in zip(_rows(task, session, piece), _rows(task, session, noisy), strict=True):
            for j, gram in enumerate(grams):
                keep = ours.steady[:, j] & theirs.steady[:, j] & ours.recorded[j]
                change = (theirs.columns[j] - ours.columns[j])[keep]
                gram += change.T @ change
                rows[j] += len(change)
    counts = np.array([joint.counts[0] for joint in given.factors.joints])
    scale = counts / np.maximum(rows, 1)
    return [gram * s for gram, s in zip(grams, scale, strict=True)], size


def _rows(task: Task, session: Session, piece: Samples) -> Iterator[Rows]:
    recording, sampling = part_of(session, piece)
    return read_rows(task, recording, sampling)


def _largest_share(given: Given, spoilt: Sequence[Array], noise: Array) -> float:
    """Of noise in the power of a combination of columns, over the combinations that the recordings tell."""
    b = given.base.rank
    whole, added = np.zeros((2, b, b))
    for joint, seen, own, sigma in zip(given.factors.joints, given.factors.columns, spoilt, noise, strict=True):
        at = np.ix_(seen, seen)
        gram = joint.grams[0][-len(seen) - 1 : -1, -len(seen) - 1 : -1]
        whole[at] += gram / sigma**2
        added[at] += own / sigma**2
    size = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    unit = whole / np.outer(size, size) + 1e-9 * np.eye(b)
    return float(scipy.linalg.eigh(added / np.outer(size, size), unit, eigvals_only=True)[-1])


PLUGIN = TotalLeastSquares()
