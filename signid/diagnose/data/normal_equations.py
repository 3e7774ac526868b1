"""Normal equations and a prior -> the likeliest coefficients, and how likely the rows are."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from ...errors import RecordingError
from ...regression.projection import least_squares
from ...types import Array, Indices, Mask
from .column_groups import Group

RIDGES = (1e-11, 1e-9, 1e-7, 1e-5)  # the first with which a Gram can be factored


class Factor(NamedTuple):
    """Of coefficients that nothing couples with others."""

    place: Indices  # (f,) where they stand among the k that are fitted
    lower: Array  # (f, f) [1] Cholesky factor of Gram and prior, scaled
    size: Array  # (f,) [1 per coefficient] the scale

    def forward(self, rows: Array) -> Array:
        """(f, m) lower^-1 of some rows (f, m) [1 per coefficient, squared]."""
        return np.asarray(solve_triangular(self.lower, rows / self.size[:, None], lower=True))

    def backward(self, below: Array) -> Array:
        """(f, m) coefficients of right sides of which lower^-1 is given.

        Args:
            below: (f, m) [1].
        """
        return np.asarray(solve_triangular(self.lower, below, lower=True, trans="T") / self.size[:, None])


class Fitted(NamedTuple):
    """What is refitted and the selected laws, at one trust in the inertials."""

    which: Indices  # (k,) columns
    factors: tuple[Factor, ...]
    forward_right: Array  # (k,) [1] lower^-1 right side
    log_evidence: float

    @property
    def value(self) -> Array:
        """(k,) the likeliest coefficients."""
        return self.backward(self.forward_right[:, None])[:, 0]

    def place(self, group: Group) -> slice:
        """Where the coefficients of a group that took part stand among those that are fitted."""
        at = int(np.flatnonzero(self.which == group.start)[0])
        return slice(at, at + group.size)

    @property
    def covariance(self) -> Array:
        """(k, k) of the coefficients."""
        out = np.zeros((len(self.which),) * 2)
        for one in self.factors:
            inverse = one.forward(np.eye(len(one.place)))
            out[np.ix_(one.place, one.place)] = inverse.T @ inverse
        return out

    def restricted(self, free: Mask) -> Fitted:
        """The likeliest coefficients while all but some (k,) stay zero."""
        value, before = np.zeros(len(self.which)), self.value
        for one in self.factors:
            inside = free[one.place]
            factor = one.size[:, None] * one.lower
            square = factor[inside] @ factor.T
            right = square @ before[one.place]
            value[one.place[inside]] = least_squares(square[:, inside], right)
        return self.with_value(value)

    def with_value(self, value: Array) -> Fitted:
        """The same with other coefficients.

        Args:
            value: (k,) [of each coefficient].
        """
        forward_right = np.zeros(len(self.which))
        for one in self.factors:
            forward_right[one.place] = one.lower.T @ (one.size * value[one.place])
        return self._replace(forward_right=forward_right)

    def forward(self, rows: Array) -> Array:
        """(k, m) lower^-1 of some rows (k, m) [1 per coefficient, squared]."""
        out = np.zeros(rows.shape)
        for one in self.factors:
            out[one.place] = one.forward(rows[one.place])
        return out

    def backward(self, below: Array) -> Array:
        """(k, m) coefficients of right sides of which lower^-1 is given.

        Args:
            below: (k, m) [1].
        """
        out = np.zeros(below.shape)
        for one in self.factors:
            out[one.place] = one.backward(below[one.place])
        return out


def solve(which: Indices, gram: Array, right: Array, precision: Array) -> Fitted:
    """The likeliest coefficients under a prior, and how likely the rows are.

    Args:
        which: (k,) columns.
        gram: (k, k) [1 per coefficient, squared].
        right: (k,) [1 per coefficient].
        precision: (k, k) [1 per coefficient, squared] of the prior.
    """
    whole = gram + precision
    size = np.asarray(np.sqrt(np.diag(whole)))
    lower = _cholesky(whole / size / size[:, None])
    forward_right = np.asarray(solve_triangular(lower, right / size, lower=True))
    half = np.linalg.slogdet(precision)[1] / 2 - float(np.sum(np.log(np.diag(lower)) + np.log(size)))
    return Fitted(
        which,
        (Factor(np.arange(len(which)), lower, size),),
        forward_right,
        float(forward_right @ forward_right) / 2 + half,
    )


def join(which: Indices, fits: Sequence[Fitted]) -> Fitted:
    """Fits of what nothing couples, as one.

    Args:
        which: (k,) columns of all of them.
        fits: of some of the columns each.
    """
    order, forward_right, factors = np.argsort(which), np.zeros(len(which)), list[Factor]()
    for fit in fits:
        place = order[np.searchsorted(which, fit.which, sorter=order)]
        forward_right[place] = fit.forward_right
        factors += [one._replace(place=place[one.place]) for one in fit.factors]
    return Fitted(which, tuple(factors), forward_right, sum(fit.log_evidence for fit in fits))


def _cholesky(scaled: Array) -> Array:
    """The factor of a matrix with a unit diagonal, which rounding may have made a little less than positive."""
    for ridge in RIDGES:
        with suppress(np.linalg.LinAlgError):
            return np.asarray(np.linalg.cholesky(scaled + ridge * np.eye(len(scaled))))
    raise RecordingError(
        "the laws and bodies that explain the recordings cannot be told apart in numbers; check the units"
    )
