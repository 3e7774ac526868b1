"""Whitened rows -> everything that is refitted or taken for true, fitted together under its prior."""

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
from .components import Component, split
from .prior import CoefficientPrior, coefficient_prior
from .recent import Recent
from .thresholds import SELECTED_SIZE

CACHED_FITS, CACHED_PARTS, CACHED_GRAMS, CACHED_PRODUCTS = 64, 256, 32, 4  # that are kept
MIN_SCALE = 1e-9  # least scale of the deviations


class StatedPrior(NamedTuple):
    """What other recordings say of the bodies and laws of the simulation: a Gaussian prior about what it states."""

    columns: Indices  # (k,) places of the coefficients
    information: Array  # (k, k) [1 per coefficient, squared] inverse of their covariance


class Memory:
    """What was computed of some columns; it stays when rows get more of them."""

    def __init__(self) -> None:
        self.coefficient_priors = dict[Group, CoefficientPrior | None]()
        self.precisions = dict[Group, Array]()
        self.imitated = dict[Group, float]()
        self.fits = Recent[Fitted](CACHED_FITS)
        self.parts = Recent[Fitted](CACHED_PARTS)
        self.components = Recent[tuple[Component, ...]](CACHED_FITS)
        self.squares = Recent[Gram](CACHED_GRAMS)
        self.stated = Recent[Array](CACHED_GRAMS)


@dataclass(frozen=True, eq=False)
class Linear(Frozen):
    """The rows' normal equations; products are made once for each hypothesis that is selected."""

    data: Whitened
    stated_prior: StatedPrior | None = None  # what other recordings say of bodies and laws
    memory: Memory = field(default_factory=Memory, repr=False)

    @cached_property
    def coefficient_priors(self) -> dict[Group, CoefficientPrior | None]:
        """Of every hypothesis."""
        kept = self.memory.coefficient_priors
        for group in self.data.groups:
            if group.hypothesis is not None and group not in kept:
                torque = {j: self.data.raw(j, group) for j in self.data.rows(group)}
                kept[group] = coefficient_prior(group.hypothesis, mean_products(torque, self.data.scale))
        return {group: kept[group] for group in self.data.groups if group.hypothesis is not None}

    def fit(self, selected: Sequence[Group], dispersion: Array, prior_scale: float) -> Fitted:
        """Everything that is refitted, and some selected hypotheses.

        Args:
            selected: hypotheses.
            dispersion: (n,) variance of the whitened residual [1].
            prior_scale: of the tolerance of inertials, how far they are off.
        """
        key = (tuple(selected), dispersion.tobytes(), prior_scale)
        return self.memory.fits(key, lambda: self._fit(selected, dispersion, prior_scale))

    def _fit(self, selected: Sequence[Group], dispersion: Array, prior_scale: float) -> Fitted:
        fits = [
            self.part(one, dispersion[list(one.joints)], prior_scale) for one in self.components(selected, prior_scale)
        ]
        return join(self.columns(selected, prior_scale), fits)

    def components(self, selected: Sequence[Group], prior_scale: float) -> tuple[Component, ...]:
        """Joints that are fitted together."""
        return self.memory.components((tuple(selected), prior_scale > 0), lambda: self._split(selected, prior_scale))

    def _split(self, selected: Sequence[Group], prior_scale: float) -> tuple[Component, ...]:
        refitted = self.refitted(prior_scale)
        known = [] if self.stated_prior is None else [g for g in refitted if g.start in self.stated_prior.columns]
        return split(self.data, refitted, selected, known)

    def part(self, component: Component, dispersion: Array, prior_scale: float) -> Fitted:
        """All that is fitted to some joints.

        Args:
            component: the joints, c of n.
            dispersion: (c,) variance of their whitened residual [1].
            prior_scale: of the tolerance of inertials, how far they are off.
        """
        key = (component, dispersion.tobytes(), prior_scale)
        return self.memory.parts(key, lambda: self._part(component, dispersion, prior_scale))

    def _part(self, component: Component, dispersion: Array, prior_scale: float) -> Fitted:
        which = columns_of(component.groups)
        square = self.memory.squares(component, lambda: self._square(component, which))
        gram = total(square, dispersion, (len(which),) * 2)
        right = (self.data.right[list(component.joints)][:, which] / dispersion[:, None]).sum(0)
        return solve(
            which, gram, right, self._precision(component.refitted, component.selected, np.diag(gram), prior_scale)
        )

    def information(self, which: Indices) -> Array:
        """(k, k) [1 per coefficient, squared] what other recordings say of some columns.

        Args:
            which: (k,) columns.
        """
        out = np.zeros((len(which),) * 2)
        if self.stated_prior is not None:
            here = np.flatnonzero(np.isin(which, self.stated_prior.columns))
            there = np.searchsorted(self.stated_prior.columns, which[here])
            out[np.ix_(here, here)] = self.stated_prior.information[np.ix_(there, there)]
        return out

    def across(self, component: Component, dispersion: Array) -> Array:
        """(k, p) products of what is fitted to some joints with all columns of these [1 per coefficient, squared].

        Args:
            component: the joints, c of n.
            dispersion: (c,) variance of their whitened residual [1].
        """
        return self._across((component, dispersion.tobytes()), lambda: self._products(component, dispersion))

    @cached_property
    def _across(self) -> Recent[Array]:
        return Recent(CACHED_PRODUCTS)

    def _products(self, component: Component, dispersion: Array) -> Array:
        which, (columns, place) = columns_of(component.groups), self.data.columns_at(component.joints)
        whole = [
            Block(rows, at, products) for (rows, products), at in zip(self._rows(component, which), place, strict=True)
        ]
        return total(tuple(whole), dispersion, (len(which), len(columns)))

    def columns(self, selected: Sequence[Group], prior_scale: float) -> Indices:
        """(k,) columns that are fitted."""
        return columns_of([*self.refitted(prior_scale), *selected])

    def refitted(self, prior_scale: float) -> list[Group]:
        """What is refitted: inertials where they are not trusted."""
        return [group for group in self.data.refitted if prior_scale > 0 or not group.bodies]

    def precision(self, selected: Sequence[Group], diagonal: Array, prior_scale: float) -> Array:
        """(k, k) [1 per coefficient, squared] of the prior.

        Args:
            selected: selected hypotheses.
            diagonal: (k,) of the Gram [1 per coefficient, squared].
            prior_scale: scale of the tolerance of inertials.
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
        """(k, k) [1 per coefficient, squared] of the prior of some groups that are fitted; 0 where it is flat.

        Args:
            groups: refitted ones first, then selected hypotheses.
            prior_scale: of the tolerance of inertials, how far they are off.
        """
        stated = tuple(group for group in groups if group.hypothesis is None)
        first = self.memory.stated((stated, prior_scale), lambda: self._stated_precision(stated, prior_scale))
        out, at = np.zeros((sum(g.size for g in groups),) * 2), len(first)
        out[:at, :at] = first
        for group in groups[len(stated) :]:
            place = slice(at, at + group.size)
            out[place, place] = self.own_precision(group)
            at += group.size
        return out

    def _stated_precision(self, groups: Sequence[Group], prior_scale: float) -> Array:
        """(k, k) [1 per coefficient, squared] of the prior of what the simulation states."""
        deviation = np.array([x * (prior_scale if group.bodies else 1.0) for group in groups for x in group.deviation])
        own = np.diag(np.where(np.isinf(deviation), 0.0, np.maximum(deviation, 1e-150) ** -2.0))
        return np.asarray(own + self.information(columns_of(groups)) / max(prior_scale, MIN_SCALE) ** 2)

    def own_precision(self, group: Group) -> Array:
        """(d, d) [1 per coefficient, squared] of the prior of a hypothesis that is selected."""
        if group not in self.memory.precisions:
            prior = self.coefficient_priors[group]
            assert prior is not None, "what does not show is never taken for true"
            covariance = SELECTED_SIZE**2 * prior.covariance_factor @ prior.covariance_factor.T
            scale = np.sqrt(np.maximum(np.diag(covariance), 1e-200))
            inverse = np.linalg.inv(covariance / scale / scale[:, None] + 1e-9 * np.eye(group.size))
            self.memory.precisions[group] = inverse / scale / scale[:, None]
        return self.memory.precisions[group]

    def imitated(self, group: Group) -> float:
        """Share of a hypothesis's torque that wrong inertials and the other refitted terms can make [1]."""
        if group not in self.memory.imitated:
            data, left, whole = self.data, 0.0, 0.0
            for j in data.rows(group):
                x = data.part(j, group)
                x = x[:, :1] if group.size == 1 else x @ np.ones((group.size, 1))
                rest = leave(x, data.chosen(j, columns_of(data.refitted))[1])
                left, whole = left + float(np.sum(rest**2)), whole + float(np.sum(x**2))
            self.memory.imitated[group] = 1 - left / whole if whole > 0 else 0.0
        return self.memory.imitated[group]

    def _square(self, component: Component, which: Indices) -> Gram:
        """Products of all that is fitted to some joints with each other."""
        out = list[Block]()
        for joint, (here, products) in zip(component.joints, self._rows(component, which), strict=True):
            out.append(Block(here, here, products[:, self.data.at[joint, which[here]]]))
        return tuple(out)

    def _rows(self, component: Component, which: Indices) -> Iterator[tuple[Indices, Array]]:
        """Joint by joint, what of some columns (k,) it has (a,), and their products with all of its columns (a, m)."""
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
