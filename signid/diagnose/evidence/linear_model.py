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
from ..data.whitened_rows import Block, Gram, Whitened, columns_of, mean_products, total
from .components import Component, split
from .prior import WIDE, Belief, believe
from .recent import Recent

FITS, PARTS, SQUARES, ACROSS = 64, 256, 32, 4  # that are kept
UNTRUSTED = 1e-9  # least scale of the deviations
FLAT = 1e-6  # of the Gram's diagonal: prior precision of what is not known at all


class Known(NamedTuple):
    """What other recordings say of the bodies and laws of the simulation: a Gaussian prior about what it states."""

    columns: Indices  # (k,) places of the coefficients
    information: Array  # (k, k) [1 per coefficient, squared] inverse of their covariance


class Memory:
    """What was computed of some columns; it stays when rows get more of them."""

    def __init__(self) -> None:
        self.beliefs = dict[Group, Belief | None]()
        self.precisions = dict[Group, Array]()
        self.imitated = dict[Group, float]()
        self.fits = Recent[Fitted](FITS)
        self.parts = Recent[Fitted](PARTS)
        self.components = Recent[tuple[Component, ...]](FITS)
        self.squares = Recent[Gram](SQUARES)
        self.stated = Recent[Array](SQUARES)


@dataclass(frozen=True, eq=False)
class Linear(Frozen):
    """The rows' normal equations; products are made once for each hypothesis that is taken for true."""

    data: Whitened
    known: Known | None = None  # what other recordings say of bodies and laws
    memory: Memory = field(default_factory=Memory, repr=False)

    @cached_property
    def beliefs(self) -> dict[Group, Belief | None]:
        """Of every hypothesis."""
        kept = self.memory.beliefs
        for group in self.data.groups:
            if group.hypothesis is not None and group not in kept:
                torque = {j: self.data.raw(j, group) for j in self.data.rows(group)}
                kept[group] = believe(group.hypothesis, mean_products(torque, self.data.scale))
        return {group: kept[group] for group in self.data.groups if group.hypothesis is not None}

    def fit(self, true: Sequence[Group], dispersion: Array, trust: float) -> Fitted:
        """Everything that is refitted, and some hypotheses that are taken for true.

        Args:
            true: hypotheses.
            dispersion: (n,) variance of the whitened residual [1].
            trust: of the tolerance of inertials, how far they are off.
        """
        key = (tuple(true), dispersion.tobytes(), trust)
        return self.memory.fits(key, lambda: self._fit(true, dispersion, trust))

    def _fit(self, true: Sequence[Group], dispersion: Array, trust: float) -> Fitted:
        fits = [self.part(one, dispersion[list(one.joints)], trust) for one in self.components(true, trust)]
        return join(self.columns(true, trust), fits)

    def components(self, true: Sequence[Group], trust: float) -> tuple[Component, ...]:
        """Joints that are fitted together."""
        return self.memory.components((tuple(true), trust > 0), lambda: self._split(true, trust))

    def _split(self, true: Sequence[Group], trust: float) -> tuple[Component, ...]:
        refitted = self.refitted(trust)
        known = [] if self.known is None else [g for g in refitted if g.start in self.known.columns]
        return split(self.data, refitted, true, known)

    def part(self, component: Component, dispersion: Array, trust: float) -> Fitted:
        """All that is fitted to some joints.

        Args:
            component: the joints, c of n.
            dispersion: (c,) variance of their whitened residual [1].
            trust: of the tolerance of inertials, how far they are off.
        """
        key = (component, dispersion.tobytes(), trust)
        return self.memory.parts(key, lambda: self._part(component, dispersion, trust))

    def _part(self, component: Component, dispersion: Array, trust: float) -> Fitted:
        which = columns_of(component.groups)
        square = self.memory.squares(component, lambda: self._square(component, which))
        gram = total(square, dispersion, (len(which),) * 2)
        right = (self.data.right[list(component.joints)][:, which] / dispersion[:, None]).sum(0)
        return solve(which, gram, right, self._precision(component.refitted, component.true, np.diag(gram), trust))

    def information(self, which: Indices) -> Array:
        """(k, k) [1 per coefficient, squared] what other recordings say of some columns.

        Args:
            which: (k,) columns.
        """
        out = np.zeros((len(which),) * 2)
        if self.known is not None:
            here = np.flatnonzero(np.isin(which, self.known.columns))
            there = np.searchsorted(self.known.columns, which[here])
            out[np.ix_(here, here)] = self.known.information[np.ix_(there, there)]
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
        return Recent(ACROSS)

    def _products(self, component: Component, dispersion: Array) -> Array:
        which, (columns, place) = columns_of(component.groups), self.data.columns_at(component.joints)
        whole = [
            Block(rows, at, products) for (rows, products), at in zip(self._rows(component, which), place, strict=True)
        ]
        return total(tuple(whole), dispersion, (len(which), len(columns)))

    def columns(self, true: Sequence[Group], trust: float) -> Indices:
        """(k,) columns that are fitted."""
        return columns_of([*self.refitted(trust), *true])

    def refitted(self, trust: float) -> list[Group]:
        """What is refitted: inertials where they are not trusted."""
        return [group for group in self.data.refitted if trust > 0 or not group.bodies]

    def precision(self, true: Sequence[Group], diagonal: Array, trust: float) -> Array:
        """(k, k) [1 per coefficient, squared] of the prior.

        Args:
            true: selected hypotheses.
            diagonal: (k,) of the Gram [1 per coefficient, squared].
            trust: scale of the tolerance of inertials.
        """
        return self._precision(self.refitted(trust), true, diagonal, trust)

    def _precision(self, refitted: Sequence[Group], true: Sequence[Group], diagonal: Array, trust: float) -> Array:
        out = self.prior_precision([*refitted, *true], trust)
        flat = np.flatnonzero([np.isinf(x) for group in refitted for x in group.deviation])
        out[flat, flat] += FLAT * np.maximum(diagonal[flat], 1e-12)
        return out

    def prior_precision(self, groups: Sequence[Group], trust: float) -> Array:
        """(k, k) [1 per coefficient, squared] of the prior of some groups that are fitted; 0 where it is flat.

        Args:
            groups: refitted ones first, then selected hypotheses.
            trust: of the tolerance of inertials, how far they are off.
        """
        stated = tuple(group for group in groups if group.hypothesis is None)
        first = self.memory.stated((stated, trust), lambda: self._stated_precision(stated, trust))
        out, at = np.zeros((sum(g.size for g in groups),) * 2), len(first)
        out[:at, :at] = first
        for group in groups[len(stated) :]:
            place = slice(at, at + group.size)
            out[place, place] = self.own_precision(group)
            at += group.size
        return out

    def _stated_precision(self, groups: Sequence[Group], trust: float) -> Array:
        """(k, k) [1 per coefficient, squared] of the prior of what the simulation states."""
        deviation = np.array([x * (trust if group.bodies else 1.0) for group in groups for x in group.deviation])
        own = np.diag(np.where(np.isinf(deviation), 0.0, np.maximum(deviation, 1e-150) ** -2.0))
        return np.asarray(own + self.information(columns_of(groups)) / max(trust, UNTRUSTED) ** 2)

    def own_precision(self, group: Group) -> Array:
        """(d, d) [1 per coefficient, squared] of the prior of a hypothesis that is taken for true."""
        if group not in self.memory.precisions:
            belief = self.beliefs[group]
            assert belief is not None, "what does not show is never taken for true"
            covariance = WIDE**2 * belief.spread @ belief.spread.T
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
