"""Joint maximum a posteriori fit of nuisance parameters and selected hypotheses under their Gaussian priors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...regression.projection import leave
from ...types import Array, Frozen, Indices
from ..data.column_groups import Group
from ..data.normal_equations import Fitted, join, solve
from ..data.thresholds import FLAT_PRECISION
from ..data.whitened_rows import Block, Gram, Whitened, columns_of, mean_products, total
from .cache import ColumnCache, LRUCache
from .components import Component, connected_components
from .prior import CoefficientPrior, coefficient_prior
from .thresholds import SELECTED_SIZE

CACHED_PRODUCTS = 4  # products of fitted columns with all columns that are kept: they are large
MIN_SCALE = 1e-9  # [1] lower bound of the prior scale k, so that its inverse exists


class StatedPrior(NamedTuple):
    """Gaussian prior of stated bodies and laws, from the recordings of an earlier identification."""

    columns: Indices  # (k,) column indices of the coefficients
    information: Array  # (k, k) [1 per coefficient, squared] inverse of their covariance, at k = 1


@dataclass(frozen=True, eq=False)
class LinearModel(Frozen):
    """Normal equations of whitened rows with priors; products are computed once for each selected hypothesis."""

    data: Whitened
    stated_prior: StatedPrior | None = None  # None: the simulation has no covariance
    cache: ColumnCache = field(default_factory=ColumnCache, repr=False)

    @cached_property
    def coefficient_priors(self) -> dict[Group, CoefficientPrior | None]:
        """Coefficient prior of every hypothesis; None if its columns are zero."""
        cached = self.cache.coefficient_priors
        for group in self.data.groups:
            if group.hypothesis is not None and group not in cached:
                torque = {j: self.data.raw(j, group) for j in self.data.rows(group)}
                cached[group] = coefficient_prior(group.hypothesis, mean_products(torque, self.data.scale))
        return {group: cached[group] for group in self.data.groups if group.hypothesis is not None}

    def fit(self, selected: Sequence[Group], dispersion: Array, prior_scale: float) -> Fitted:
        """Fit nuisance parameters and selected hypotheses together.

        Args:
            selected: selected hypotheses.
            dispersion: (n,) c, variance of the whitened residual [1].
            prior_scale: k, error of the simulation in standard deviations of its prior [1].
        """
        key = (tuple(selected), dispersion.tobytes(), prior_scale)
        return self.cache.fits(key, lambda: self._fit(selected, dispersion, prior_scale))

    def _fit(self, selected: Sequence[Group], dispersion: Array, prior_scale: float) -> Fitted:
        fits = [
            self.part(one, dispersion[list(one.joints)], prior_scale) for one in self.components(selected, prior_scale)
        ]
        return join(self.columns(selected, prior_scale), fits)

    def components(self, selected: Sequence[Group], prior_scale: float) -> tuple[Component, ...]:
        """Connected components of joints, which are fitted independently."""
        return self.cache.components((tuple(selected), prior_scale > 0), lambda: self._split(selected, prior_scale))

    def _split(self, selected: Sequence[Group], prior_scale: float) -> tuple[Component, ...]:
        refitted = self.refitted(prior_scale)
        prior = self.stated_prior
        coupled = [] if prior is None else [g for g in refitted if g.start in prior.columns]
        return connected_components(self.data, refitted, selected, coupled)

    def part(self, component: Component, dispersion: Array, prior_scale: float) -> Fitted:
        """Fit of one connected component.

        Args:
            component: the component, m of the n joints.
            dispersion: (m,) c, variance of the whitened residual [1].
            prior_scale: k, error of the simulation in standard deviations of its prior [1].
        """
        key = (component, dispersion.tobytes(), prior_scale)
        return self.cache.component_fits(key, lambda: self._part(component, dispersion, prior_scale))

    def _part(self, component: Component, dispersion: Array, prior_scale: float) -> Fitted:
        which = columns_of(component.groups)
        square = self.cache.grams(component, lambda: self._square(component, which))
        gram = total(square, dispersion, (len(which),) * 2)
        right = (self.data.right[list(component.joints)][:, which] / dispersion[:, None]).sum(0)
        return solve(
            which, gram, right, self._precision(component.refitted, component.selected, np.diag(gram), prior_scale)
        )

    def information(self, which: Indices) -> Array:
        """(k, k) [1 per coefficient, squared] information of the stated prior about some columns, at k = 1.

        Args:
            which: (k,) indices of columns.
        """
        out = np.zeros((len(which),) * 2)
        if self.stated_prior is not None:
            here = np.flatnonzero(np.isin(which, self.stated_prior.columns))
            there = np.searchsorted(self.stated_prior.columns, which[here])
            out[np.ix_(here, here)] = self.stated_prior.information[np.ix_(there, there)]
        return out

    def across(self, component: Component, dispersion: Array) -> Array:
        """(k, p) [1 per coefficient, squared] products of the fitted columns of a component with all its columns.

        Args:
            component: the component, m of the n joints.
            dispersion: (m,) c, variance of the whitened residual [1].
        """
        return self._across((component, dispersion.tobytes()), lambda: self._products(component, dispersion))

    @cached_property
    def _across(self) -> LRUCache[Array]:
        return LRUCache(CACHED_PRODUCTS)

    def _products(self, component: Component, dispersion: Array) -> Array:
        which, (columns, place) = columns_of(component.groups), self.data.columns_at(component.joints)
        whole = [
            Block(rows, at, products) for (rows, products), at in zip(self._rows(component, which), place, strict=True)
        ]
        return total(tuple(whole), dispersion, (len(which), len(columns)))

    def columns(self, selected: Sequence[Group], prior_scale: float) -> Indices:
        """(k,) indices of the fitted columns."""
        return columns_of([*self.refitted(prior_scale), *selected])

    def refitted(self, prior_scale: float) -> list[Group]:
        """Nuisance terms; inertial parameters only if the prior scale is above zero."""
        return [group for group in self.data.refitted if prior_scale > 0 or not group.bodies]

    def precision(self, selected: Sequence[Group], diagonal: Array, prior_scale: float) -> Array:
        """(k, k) [1 per coefficient, squared] prior precision L of all fitted coefficients.

        Args:
            selected: selected hypotheses.
            diagonal: (k,) diagonal of the Gram, for flat priors [1 per coefficient, squared].
            prior_scale: k, error of the simulation in standard deviations of its prior [1].
        """
        return self._precision(self.refitted(prior_scale), selected, diagonal, prior_scale)

    def _precision(
        self, refitted: Sequence[Group], selected: Sequence[Group], diagonal: Array, prior_scale: float
    ) -> Array:
        out = self.prior_precision([*refitted, *selected], prior_scale)
        flat = np.flatnonzero([np.isinf(x) for group in refitted for x in group.deviation])
        out[flat, flat] += FLAT_PRECISION * np.maximum(diagonal[flat], 1e-12)
        return out

    def prior_precision(self, groups: Sequence[Group], prior_scale: float) -> Array:
        """(k, k) [1 per coefficient, squared] prior precision of some groups; 0 where the prior is flat.

        Args:
            groups: nuisance terms first, then selected hypotheses.
            prior_scale: k, error of the simulation in standard deviations of its prior [1].
        """
        stated = tuple(group for group in groups if group.hypothesis is None)
        first = self.cache.stated_precisions((stated, prior_scale), lambda: self._stated_precision(stated, prior_scale))
        out, at = np.zeros((sum(g.size for g in groups),) * 2), len(first)
        out[:at, :at] = first
        for group in groups[len(stated) :]:
            place = slice(at, at + group.size)
            out[place, place] = self.own_precision(group)
            at += group.size
        return out

    def _stated_precision(self, groups: Sequence[Group], prior_scale: float) -> Array:
        """(k, k) [1 per coefficient, squared] prior precision of nuisance terms."""
        deviation = np.array([x * (prior_scale if group.bodies else 1.0) for group in groups for x in group.deviation])
        own = np.diag(np.where(np.isinf(deviation), 0.0, np.maximum(deviation, 1e-150) ** -2.0))
        return np.asarray(own + self.information(columns_of(groups)) / max(prior_scale, MIN_SCALE) ** 2)

    def own_precision(self, group: Group) -> Array:
        """(d, d) [1 per coefficient, squared] prior precision of a selected hypothesis."""
        if group not in self.cache.precisions:
            prior = self.coefficient_priors[group]
            assert prior is not None, "a hypothesis with zero columns is never selected"
            covariance = SELECTED_SIZE**2 * prior.covariance_factor @ prior.covariance_factor.T
            scale = np.sqrt(np.maximum(np.diag(covariance), 1e-200))
            inverse = np.linalg.inv(covariance / scale / scale[:, None] + 1e-9 * np.eye(group.size))
            self.cache.precisions[group] = inverse / scale / scale[:, None]
        return self.cache.precisions[group]

    def imitated(self, group: Group) -> float:
        """Share of a hypothesis's squared torque that the nuisance terms can explain [1]."""
        if group not in self.cache.imitated:
            data, left, whole = self.data, 0.0, 0.0
            for j in data.rows(group):
                x = data.part(j, group)
                x = x[:, :1] if group.size == 1 else x @ np.ones((group.size, 1))
                rest = leave(x, data.chosen(j, columns_of(data.refitted))[1])
                left, whole = left + float(np.sum(rest**2)), whole + float(np.sum(x**2))
            self.cache.imitated[group] = 1 - left / whole if whole > 0 else 0.0
        return self.cache.imitated[group]

    def _square(self, component: Component, which: Indices) -> Gram:
        """Products of the fitted columns of a component with each other."""
        out = list[Block]()
        for joint, (here, products) in zip(component.joints, self._rows(component, which), strict=True):
            out.append(Block(here, here, products[:, self.data.at[joint, which[here]]]))
        return tuple(out)

    def _rows(self, component: Component, which: Indices) -> Iterator[tuple[Indices, Array]]:
        """For each joint, its positions (a,) among columns (k,), and their products with all its columns (a, m)."""
        for joint in component.joints:
            grams = [self._gram_of(group)[joint] for group in component.groups]
            products = [gram.products for gram in grams if len(gram.rows)]
            empty = np.zeros((0, len(self.data.place[joint])))
            yield np.flatnonzero(self.data.at[joint, which] >= 0), np.concatenate([empty, *products])

    def _gram_of(self, group: Group) -> Gram:
        if group not in self._seen:
            self._seen[group] = self.data.gram(columns_of([group]))
        return self._seen[group]

    @cached_property
    def _seen(self) -> dict[Group, Gram]:
        return {}
