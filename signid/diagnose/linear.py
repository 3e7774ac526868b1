"""Whitened rows -> everything that is refitted or taken for true, fitted together under its prior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..residual import leave
from ..types import Array, Frozen, Indices
from .fitted import Fitted, solve
from .group import Group
from .prior import WIDE, Belief, believe
from .recent import Recent
from .whitened import Block, Gram, Whitened, columns_of, mean_products, total

FITS, SQUARES = 64, 16  # that are kept
FLAT = 1e-6  # of the Gram's diagonal: prior precision of what is not known at all


class Known(NamedTuple):
    """Information on the bodies' inertial parameters from other recordings; friction may differ from day to day."""

    information: Array  # (k, k) [1 per coefficient, squared]
    right: Array  # (k,) [1 per coefficient]


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
        square = self._squares(tuple(true), lambda: self._square(true))
        gram = total(square, dispersion, (len(self._could(true)),) * 2)[np.ix_(rows, rows)]
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
        whole = self._across((tuple(true), dispersion.tobytes()), lambda: self._across_all(true, dispersion))
        return whole if trust > 0 else np.asarray(whole[self._which_rows(true, trust)])

    @cached_property
    def _across(self) -> Recent[Array]:
        return Recent(1)

    def _across_all(self, true: Sequence[Group], dispersion: Array) -> Array:
        """(k, p) of all that could be refitted and some hypotheses."""
        parts = [(self.data.refitted_gram, len(columns_of(self.data.refitted)))]
        parts += [(self._gram_of(group), group.size) for group in true]
        return np.concatenate([total(gram, dispersion, (k, self.data.count)) for gram, k in parts])

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
            for j in data.rows(group):
                x = data.part(j, group)
                x = x[:, :1] if group.size == 1 else x @ np.ones((group.size, 1))
                rest = leave(x, data.chosen(j, columns_of(data.refitted))[1])
                left, whole = left + float(np.sum(rest**2)), whole + float(np.sum(x**2))
            self._imitated[group] = 1 - left / whole if whole > 0 else 0.0
        return self._imitated[group]

    @cached_property
    def _imitated(self) -> dict[Group, float]:
        return {}

    def _which_rows(self, true: Sequence[Group], trust: float) -> Indices:
        """(k,) places of the columns that are fitted among those that could be."""
        return np.flatnonzero(np.isin(self._could(true), self.columns(true, trust)))

    def _could(self, true: Sequence[Group]) -> Indices:
        """(k,) columns of all that could be refitted and some hypotheses."""
        return columns_of([*self.data.refitted, *true])

    def _square(self, true: Sequence[Group]) -> Gram:
        """Products of all that could be refitted and some hypotheses with each other."""
        which, out = self._could(true), list[Block]()
        grams = [self.data.refitted_gram, *(self._gram_of(group) for group in true)]
        for j, at in enumerate(self.data.at[:, which]):
            here = np.flatnonzero(at >= 0)
            rows = [gram[j].products[:, at[here]] for gram in grams if len(gram[j].rows)]
            out.append(Block(here, here, np.concatenate([np.zeros((0, len(here))), *rows])))
        return tuple(out)

    def _gram_of(self, group: Group) -> Gram:
        if group not in self._seen:
            self._seen[group] = self.data.gram(columns_of([group]))
        return self._seen[group]

    @cached_property
    def _seen(self) -> dict[Group, Gram]:
        return {}

    @cached_property
    def _squares(self) -> Recent[Gram]:
        return Recent(SQUARES)
