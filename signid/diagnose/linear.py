"""Whitened rows -> everything that is refitted or taken for true, fitted together under its prior."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from ..errors import RecordingError
from ..residual import leave
from ..types import Array, Frozen, Indices
from .group import Group
from .prior import WIDE, Belief, believe
from .recent import Recent
from .whitened import Whitened, columns_of, mean_products

FITS = 64  # that are kept
RIDGES = (1e-11, 1e-9, 1e-7, 1e-5)  # the first with which a Gram can be factored
FLAT = 1e-6  # of the Gram's diagonal: prior precision of what is not known at all


class Known(NamedTuple):
    """Information on the bodies' inertial parameters from other recordings; friction may differ from day to day."""

    information: Array  # (k, k) [1 per coefficient, squared]
    right: Array  # (k,) [1 per coefficient]


class Fitted(NamedTuple):
    """What is refitted and what is taken for true, at one trust in the inertials."""

    which: Indices  # (k,) columns
    lower: Array  # (k, k) [1] Cholesky factor of Gram and prior, scaled
    size: Array  # (k,) [1 per coefficient] the scale
    told: Array  # (k,) [1] lower^-1 right side
    log_evidence: float

    @property
    def value(self) -> Array:
        """(k,) the likeliest coefficients."""
        return self.solved(self.told[:, None])[:, 0]

    def place(self, group: Group) -> slice:
        """Where the coefficients of a group that took part stand among those that are fitted."""
        at = int(np.flatnonzero(self.which == group.start)[0])
        return slice(at, at + group.size)

    @property
    def covariance(self) -> Array:
        """(k, k) of the coefficients."""
        inverse = solve_triangular(self.lower, np.eye(len(self.size)), lower=True) / self.size
        return np.asarray(inverse.T @ inverse)

    def below(self, rows: Array) -> Array:
        """(k, m) lower^-1 of some rows (k, m) [1 per coefficient, squared]."""
        return np.asarray(solve_triangular(self.lower, rows / self.size[:, None], lower=True))

    def solved(self, below: Array) -> Array:
        """(k, m) coefficients of right sides of which lower^-1 is given.

        Args:
            below: (k, m) [1].
        """
        return np.asarray(solve_triangular(self.lower, below, lower=True, trans="T") / self.size[:, None])


@dataclass(frozen=True, eq=False)
class Linear(Frozen):
    """The rows' normal equations; products are made once for each hypothesis that is taken for true."""

    data: Whitened
    known: Known | None = None  # what other recordings tell of the bodies

    @cached_property
    def beliefs(self) -> dict[Group, Belief | None]:
        """Of every hypothesis."""
        data = self.data
        return {
            group: believe(
                group.hypothesis, mean_products({j: data.raw(j, group) for j in data.rows(group)}, data.scale)
            )
            for group in data.groups
            if group.hypothesis is not None
        }

    def fit(self, true: Sequence[Group], dispersion: Array, trust: float) -> Fitted:
        """Everything that is refitted, and some hypotheses that are taken for true.

        Args:
            true: hypotheses.
            dispersion: (n,) variance of the whitened residual [1].
            trust: of the tolerance of inertials, how far they are off.
        """
        key = (tuple(true), dispersion.tobytes(), trust)
        return self._fits(key, lambda: self._fit(true, dispersion, trust))

    @cached_property
    def _fits(self) -> Recent[Fitted]:
        return Recent(FITS)

    def _fit(self, true: Sequence[Group], dispersion: Array, trust: float) -> Fitted:
        which, rows = self.columns(true, trust), self._which_rows(true, trust)
        gram = np.tensordot(1 / dispersion, self._square(tuple(true)), axes=1)[np.ix_(rows, rows)]
        right = (self.data.right[:, which] / dispersion[:, None]).sum(0)
        if self.known is not None and trust > 0:
            here = np.searchsorted(which, columns_of([group for group in self.data.refitted if group.bodies]))
            gram[np.ix_(here, here)] += self.known.information
            right[here] += self.known.right
        precision = self.precision(true, np.diag(gram), trust)
        return solve(which, gram, right, precision)

    def across(self, true: Sequence[Group], dispersion: Array, trust: float) -> Array:
        """(k, p) products of the columns that are fitted with all [1 per coefficient, squared].

        Args:
            true: hypotheses.
            dispersion: (n,) variance of the whitened residual [1].
            trust: of the tolerance of inertials, how far they are off.
        """
        parts = [self.data.refitted_gram, *(self._gram_of(group) for group in true)]
        whole = np.concatenate([np.tensordot(1 / dispersion, part, axes=1) for part in parts])
        return np.asarray(whole[self._which_rows(true, trust)])

    def columns(self, true: Sequence[Group], trust: float) -> Indices:
        """(k,) columns that are fitted."""
        return columns_of([*self.refitted(trust), *true])

    def refitted(self, trust: float) -> list[Group]:
        """What is refitted: inertials where they are not trusted."""
        return [group for group in self.data.refitted if trust > 0 or not group.bodies]

    def precision(self, true: Sequence[Group], diagonal: Array, trust: float) -> Array:
        """(k, k) [1 per coefficient, squared] of the prior.

        Args:
            true: hypotheses that are taken for true.
            diagonal: (k,) of the Gram [1 per coefficient, squared].
            trust: of the tolerance of inertials, how far they are off.
        """
        spread = [np.array(g.deviation) * (trust if g.bodies else 1.0) for g in self.refitted(trust)]
        deviation = np.concatenate([*spread, np.zeros(0)])
        at, out = len(deviation), np.zeros((len(diagonal), len(diagonal)))
        flat = FLAT * np.maximum(diagonal[:at], 1e-12)
        out[range(at), range(at)] = np.where(np.isinf(deviation), flat, np.maximum(deviation, 1e-150) ** -2.0)
        for group in true:
            out[at : at + group.size, at : at + group.size] = self.own_precision(group)
            at += group.size
        return out

    def own_precision(self, group: Group) -> Array:
        """(d, d) [1 per coefficient, squared] of the prior of a hypothesis that is taken for true."""
        if group not in self._precisions:
            belief = self.beliefs[group]
            assert belief is not None, "what does not show is never taken for true"
            covariance = (1.0 if belief.mean else WIDE**2) * belief.spread @ belief.spread.T
            scale = np.sqrt(np.maximum(np.diag(covariance), 1e-200))
            inverse = np.linalg.inv(covariance / scale / scale[:, None] + 1e-9 * np.eye(group.size))
            self._precisions[group] = inverse / scale / scale[:, None]
        return self._precisions[group]

    @cached_property
    def _precisions(self) -> dict[Group, Array]:
        return {}

    def imitated(self, group: Group) -> float:
        """Share of a hypothesis's torque that wrong inertials and the other refitted terms can make [1]."""
        if group not in self._imitated:
            data, left, whole = self.data, 0.0, 0.0
            for j in range(data.joints):
                x = data.part(j, group)
                x = x[:, :1] if group.size == 1 else x @ np.ones((group.size, 1))
                rest = leave(x, np.column_stack([data.part(j, other) for other in data.refitted]))
                left, whole = left + float(np.sum(rest**2)), whole + float(np.sum(x**2))
            self._imitated[group] = 1 - left / whole if whole > 0 else 0.0
        return self._imitated[group]

    @cached_property
    def _imitated(self) -> dict[Group, float]:
        return {}

    def _which_rows(self, true: Sequence[Group], trust: float) -> Indices:
        """(k,) places of the columns that are fitted among those that could be."""
        return np.flatnonzero(np.isin(columns_of([*self.data.refitted, *true]), self.columns(true, trust)))

    def _square(self, true: tuple[Group, ...]) -> Array:
        """(n, k, k) products of all that could be refitted and some hypotheses."""
        if true not in self._seen_squares:
            which = columns_of([*self.data.refitted, *true])
            parts = [self.data.refitted_gram, *(self._gram_of(group) for group in true)]
            self._seen_squares[true] = np.concatenate([part[:, :, which] for part in parts], axis=1)
        return self._seen_squares[true]

    def _gram_of(self, group: Group) -> Array:
        if group not in self._seen:
            self._seen[group] = self.data.gram(columns_of([group]))
        return self._seen[group]

    @cached_property
    def _seen(self) -> dict[Group, Array]:
        return {}

    @cached_property
    def _seen_squares(self) -> dict[tuple[Group, ...], Array]:
        return {}


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
    told = np.asarray(solve_triangular(lower, right / size, lower=True))
    half = np.linalg.slogdet(precision)[1] / 2 - float(np.sum(np.log(np.diag(lower)) + np.log(size)))
    return Fitted(which, lower, size, told, float(told @ told) / 2 + half)


def _cholesky(scaled: Array) -> Array:
    """The factor of a matrix with a unit diagonal, which rounding may have made a little less than positive."""
    for ridge in RIDGES:
        with suppress(np.linalg.LinAlgError):
            return np.asarray(np.linalg.cholesky(scaled + ridge * np.eye(len(scaled))))
    raise RecordingError(
        "the laws and bodies that explain the recordings cannot be told apart in numbers; check the units"
    )
