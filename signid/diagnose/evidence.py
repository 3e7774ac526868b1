"""Whitened rows -> how much more likely each hypothesis makes them, in closed form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr, logsumexp

from ..types import Array, Indices
from .cross import Unseen, leave_out
from .fitted import Fitted
from .group import Group
from .linear import Linear
from .prior import SIZES, Belief
from .recent import Recent

TRUST = np.array([0.0, 1.0, 2.0])  # of the tolerance of inertials: how far they are off
TRUST_PRIOR = np.log([0.5, 0.4, 0.1])


class Batch(NamedTuple):
    """Groups of one size d, with what is needed of them at once."""

    groups: Indices  # (g,) their places in the list of groups
    columns: Indices  # (g, d)
    blocks: Array  # (n, g, d, d) [1 per coefficient, squared] own products per joint
    spread: Array  # (g, d, d) [units of the coefficients]
    mean: Array  # (g,) [1]
    first: Array  # (g, d) [units of the coefficients] spread of the positive coefficient, NaN where none is


class Left(NamedTuple):
    """What everything that is fitted leaves of all columns."""

    below: Array  # (k, p) [1 per coefficient] what it makes of them, by the fit's factor
    right: Array  # (p,) [1 per coefficient]
    own: list[Array]  # of each batch (g, d, d) [1 per coefficient, squared]


@dataclass(frozen=True, eq=False)
class Evidence(Linear):
    """Rows that can be asked what any hypothesis adds to others that are taken for true."""

    def weigh(self, true: Sequence[Group], dispersion: Array, without: Group | None = None) -> tuple[Array, Array]:
        """Log Bayes factor of every group (NaN for those that are refitted or true), and the weight of each trust.

        Args:
            true: hypotheses that are taken for true.
            dispersion: (n,) variance of the whitened residual [1].
            without: one of them that is not, after all; to ask so of each in turn costs little more than of one.
        """
        kept = {group for group in true if group is not without}
        fits = [self.fit([group for group in true if group in kept], dispersion, trust) for trust in TRUST]
        weight = TRUST_PRIOR + np.array([fit.log_evidence for fit in fits])
        weight = weight - logsumexp(weight)
        factors = np.array([self._factors(self._left(true, dispersion, trust, without)) for trust in TRUST])
        factors = factors + weight[:, None]
        factors[:, [k for k, group in enumerate(self.data.groups) if group in kept]] = np.nan
        return np.asarray(logsumexp(factors, axis=0)), np.exp(weight)

    def trust(self, true: Sequence[Group], dispersion: Array) -> float:
        """The likeliest distrust of the inertials.

        Args:
            true: hypotheses that are taken for true.
            dispersion: (n,) variance of the whitened residual [1].
        """
        told = [self.fit(true, dispersion, trust).log_evidence for trust in TRUST]
        return float(TRUST[int(np.argmax(told + TRUST_PRIOR))])

    def ask(self, fit: Fitted, dispersion: Array, belief: Belief, columns: Mapping[int, Array]) -> float:
        """Log Bayes factor of columns that are not among the rows' own.

        Args:
            fit: everything that is refitted or taken for true.
            dispersion: (n,) variance of the whitened residual [1].
            belief: of the coefficients.
            columns: per joint (M, d) whitened [1 per coefficient].
        """
        own, right, across = self.data.products(fit.which, dispersion, columns)
        below = fit.below(across)
        first = belief.spread[belief.positive] if belief.positive >= 0 else belief.spread[0] * np.nan
        none, empty = np.zeros(1, dtype=np.intp), np.zeros(0)
        batch = Batch(none, none, empty, belief.spread[None], np.array([belief.mean]), first[None])
        return float(_log_factor(batch, (own - below.T @ below)[None], (right - below.T @ fit.told)[None])[0])

    def gain_unseen(self, true: Sequence[Group], group: Group, dispersion: Array, trust: float) -> float:
        """By how much a hypothesis lessens the squared whitened residual of blocks that it was not fitted to [1].

        Args:
            true: hypotheses that are taken for true beside it.
            group: the hypothesis.
            dispersion: (n,) variance of the whitened residual [1].
            trust: of the tolerance of inertials, how far they are off.
        """
        key = (tuple(true), dispersion.tobytes(), trust)
        return self._unseen(key, lambda: leave_out(self, true, dispersion, trust)).gain(group)

    @cached_property
    def _unseen(self) -> Recent[Unseen]:
        return Recent(len(TRUST))

    @cached_property
    def _batches(self) -> list[Batch]:
        data, by_size = self.data, dict[int, list[int]]()
        for k, group in enumerate(data.groups):
            if group.hypothesis is not None and self.beliefs[group] is not None:
                by_size.setdefault(group.size, []).append(k)
        return [self._batch(np.array(which, dtype=np.intp)) for which in by_size.values()]

    def _batch(self, which: Indices) -> Batch:
        data, groups = self.data, [self.data.groups[k] for k in which]
        beliefs = [self.beliefs[group] for group in groups]
        blocks = np.zeros((data.joints, len(groups), groups[0].size, groups[0].size))
        for j in range(data.joints):
            there = np.isin([g.start for g in groups], data.place[j])
            own = [data.part(j, group) for group, yes in zip(groups, there, strict=True) if yes]
            if own:
                x = np.stack(own)
                blocks[j, there] = x.transpose(0, 2, 1) @ x
        spread = np.array([b.spread for b in beliefs if b is not None])
        first = np.array([b.spread[b.positive] if b.positive >= 0 else b.spread[0] * np.nan for b in beliefs if b])
        mean = np.array([b.mean for b in beliefs if b is not None])
        columns = np.array([np.arange(g.start, g.start + g.size) for g in groups], dtype=np.intp)
        return Batch(which, columns, blocks, spread, mean, first)

    def _left(self, true: Sequence[Group], dispersion: Array, trust: float, without: Group | None) -> Left:
        key = (tuple(true), dispersion.tobytes(), trust)
        left = self._lefts(key, lambda: self._left_by_all(true, dispersion, trust))
        if without is None:
            return left
        fit = self.fit(true, dispersion, trust)
        below = fit.below(np.eye(len(fit.which))[:, fit.place(without)])
        shares = below.T @ left.below  # (d, p) of what it would make of each column
        back = np.linalg.solve(below.T @ below, shares)
        own = [
            x + np.einsum("dgi,dgj->gij", shares[:, batch.columns], back[:, batch.columns])
            for x, batch in zip(left.own, self._batches, strict=True)
        ]
        return Left(left.below, left.right + back.T @ (below.T @ fit.told), own)

    @cached_property
    def _lefts(self) -> Recent[Left]:
        return Recent(len(TRUST))

    def _left_by_all(self, true: Sequence[Group], dispersion: Array, trust: float) -> Left:
        fit, own = self.fit(true, dispersion, trust), list[Array]()
        below = fit.below(self.across(true, dispersion, trust))
        right = (self.data.right / dispersion[:, None]).sum(0) - below.T @ fit.told
        for batch in self._batches:
            across = below.T[batch.columns]  # (g, d, k)
            own.append(np.tensordot(1 / dispersion, batch.blocks, axes=1) - across @ across.transpose(0, 2, 1))
        return Left(below, right, own)

    def _factors(self, left: Left) -> Array:
        """(groups,) log Bayes factors at one trust."""
        out = np.full(len(self.data.groups), np.nan)
        for batch, own in zip(self._batches, left.own, strict=True):
            out[batch.groups] = _log_factor(batch, own, left.right[batch.columns])
        return out


def _log_factor(batch: Batch, own: Array, right: Array) -> Array:
    """(g,) log Bayes factors, sizes averaged.

    Args:
        batch: g groups of d columns.
        own: (g, d, d) Gram, less what is fitted beside.
        right: (g, d) right side, less what is fitted beside.
    """
    mean = batch.mean[:, None] * np.ones(right.shape)
    shift = np.sum(right * mean, axis=1) - np.einsum("gi,gij,gj->g", mean, own, mean) / 2
    right = right - np.einsum("gij,gj->gi", own, mean)
    spread = batch.spread
    values, vectors = np.linalg.eigh(spread.transpose(0, 2, 1) @ own @ spread)
    w = np.maximum(values, 0)  # (g, d)
    turned = spread @ vectors
    z = np.einsum("gij,gi->gj", turned, right)
    f = np.where(batch.mean[:, None] != 0, 1.0, SIZES) ** 2  # (g, 4)
    fw = 1 + f[:, :, None] * w[:, None, :]  # (g, 4, d)
    told = np.sum(f[:, :, None] * z[:, None, :] ** 2 / fw - np.log(fw), axis=2) / 2
    first = np.einsum("gi,gij->gj", np.nan_to_num(batch.first), vectors)
    mid = np.sum(first[:, None, :] * f[:, :, None] * z[:, None, :] / fw, axis=2)
    wide = np.sqrt(np.maximum(np.sum(first[:, None, :] ** 2 * f[:, :, None] / fw, axis=2), 1e-300))
    told = told + np.where(np.isnan(batch.first[:, :1]), 0.0, np.log(2) + log_ndtr(mid / wide))
    return np.asarray(shift + logsumexp(told, axis=1) - np.log(len(SIZES)))
