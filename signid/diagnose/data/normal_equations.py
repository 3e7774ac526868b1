"""Normal equations with a Gaussian prior: maximum a posteriori coefficients and marginal likelihood."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from ...errors import RecordingError
from ...regression.projection import least_squares
from ...types import Array, Indices, Mask
from .column_groups import Group

RIDGES = (1e-11, 1e-9, 1e-7, 1e-5)  # [1] added to a unit diagonal: the first with which the matrix can be factored


class Factor(NamedTuple):
    """Cholesky factor of a block of coefficients that is not coupled with the others."""

    place: Indices  # (f,) positions of the block among the k fitted coefficients
    lower: Array  # (f, f) [1] Cholesky factor of Gram plus prior precision, scaled to a unit diagonal
    size: Array  # (f,) [1 per coefficient] square root of the diagonal before scaling

    def forward(self, rows: Array) -> Array:
        """(f, m) [1 per coefficient] forward substitution lower^-1 rows; rows (f, m) [1 per coefficient, squared]."""
        return np.asarray(solve_triangular(self.lower, rows / self.size[:, None], lower=True))

    def backward(self, below: Array) -> Array:
        """(f, m) [unit of each coefficient] back substitution lower^-T below; below (f, m) [1]."""
        return np.asarray(solve_triangular(self.lower, below, lower=True, trans="T") / self.size[:, None])


class Fitted(NamedTuple):
    """Fit of nuisance parameters and selected laws at one prior scale k."""

    which: Indices  # (k,) fitted columns
    factors: tuple[Factor, ...]
    forward_right: Array  # (k,) [1] lower^-1 right-hand side
    log_evidence: float  # log marginal likelihood against no fit at all [-]

    @property
    def value(self) -> Array:
        """(k,) [unit of each coefficient] maximum a posteriori."""
        return self.backward(self.forward_right[:, None])[:, 0]

    def place(self, group: Group) -> slice:
        """Slice of the coefficients of a fitted group."""
        at = int(np.flatnonzero(self.which == group.start)[0])
        return slice(at, at + group.size)

    @property
    def covariance(self) -> Array:
        """(k, k) [units of the coefficients, squared] posterior covariance."""
        out = np.zeros((len(self.which),) * 2)
        for one in self.factors:
            inverse = one.forward(np.eye(len(one.place)))
            out[np.ix_(one.place, one.place)] = inverse.T @ inverse
        return out

    def restricted(self, free: Mask) -> Fitted:
        """Fit again with all coefficients zero except those that are free (k,)."""
        value, before = np.zeros(len(self.which)), self.value
        for one in self.factors:
            inside = free[one.place]
            factor = one.size[:, None] * one.lower
            square = factor[inside] @ factor.T
            right = square @ before[one.place]
            value[one.place[inside]] = least_squares(square[:, inside], right)
        return self.with_value(value)

    def with_value(self, value: Array) -> Fitted:
        """The same fit with coefficients of another value (k,) [unit of each coefficient]."""
        forward_right = np.zeros(len(self.which))
        for one in self.factors:
            forward_right[one.place] = one.lower.T @ (one.size * value[one.place])
        return self._replace(forward_right=forward_right)

    def forward(self, rows: Array) -> Array:
        """(k, m) [1 per coefficient] forward substitution lower^-1 rows; rows (k, m) [1 per coefficient, squared]."""
        return self._blockwise(Factor.forward, rows)

    def backward(self, below: Array) -> Array:
        """(k, m) [unit of each coefficient] back substitution lower^-T below; below (k, m) [1]."""
        return self._blockwise(Factor.backward, below)

    def _blockwise(self, substitute: Callable[[Factor, Array], Array], x: Array) -> Array:
        out = np.zeros(x.shape)
        for one in self.factors:
            out[one.place] = substitute(one, x[one.place])
        return out


def solve(which: Indices, gram: Array, right: Array, precision: Array) -> Fitted:
    """Maximum a posteriori coefficients of the columns `which` (k,) [1], and log marginal likelihood of the rows.

    gram (k, k) [1 per coefficient, squared] is F'F, precision (k, k) [same] L, and right (k,) [1 per coefficient] F'y.
    """
    whole = gram + precision
    size = np.asarray(np.sqrt(np.diag(whole)))
    lower = _cholesky(whole / size / size[:, None])
    forward_right = np.asarray(solve_triangular(lower, right / size, lower=True))
    half = np.linalg.slogdet(precision)[1] / 2 - float(np.sum(np.log(np.diag(lower)) + np.log(size)))
    factor = Factor(np.arange(len(which)), lower, size)
    return Fitted(which, (factor,), forward_right, float(forward_right @ forward_right) / 2 + half)


def join(which: Indices, fits: Sequence[Fitted]) -> Fitted:
    """Join fits of uncoupled blocks, disjoint sets of the columns `which` (k,) [1]."""
    order, forward_right, factors = np.argsort(which), np.zeros(len(which)), list[Factor]()
    for fit in fits:
        place = order[np.searchsorted(which, fit.which, sorter=order)]
        forward_right[place] = fit.forward_right
        factors += [one._replace(place=place[one.place]) for one in fit.factors]
    return Fitted(which, tuple(factors), forward_right, sum(fit.log_evidence for fit in fits))


def _cholesky(scaled: Array) -> Array:
    """Cholesky factor of a matrix with a unit diagonal that may be slightly indefinite by rounding."""
    for ridge in RIDGES:
        with suppress(np.linalg.LinAlgError):
            return np.asarray(np.linalg.cholesky(scaled + ridge * np.eye(len(scaled))))
    raise RecordingError(
        "the normal equations of the selected laws are singular, so nothing can be estimated; check the units"
    )
