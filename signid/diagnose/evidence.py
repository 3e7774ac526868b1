"""Whitened rows -> how much more likely each hypothesis makes them, in closed form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import log_ndtr, logsumexp

from ..types import Array, Frozen, Indices
from .group import Group
from .prior import SIZES, WIDE, Belief, believe
from .whitened import Whitened, columns_of, mean_products

TRUST = np.array([0.0, 1.0, 2.0])  # of the tolerance of inertials: how far they are off
TRUST_PRIOR = np.log([0.5, 0.4, 0.1])
FLAT = 1e-6  # of the Gram's diagonal: prior precision of what is not known at all


class Fitted(NamedTuple):
    """What is refitted and what is taken for true, at one trust in the inertials."""

    which: Indices  # (k,) columns
    lower: Array  # (k, k) [1] Cholesky factor of Gram and prior, scaled
    size: Array  # (k,) [1 per coefficient] the scale
    across: Array  # (k, p) [1 per coefficient] lower^-1 Gram rows
    told: Array  # (k,) [1] lower^-1 right side
    log_evidence: float

    @property
    def value(self) -> Array:
        """(k,) the likeliest coefficients."""
        return np.asarray(solve_triangular(self.lower, self.told, lower=True, trans="T") / self.size)

    @property
    def covariance(self) -> Array:
        """(k, k) of the coefficients."""
        inverse = solve_triangular(self.lower, np.eye(len(self.size)), lower=True) / self.size
        return np.asarray(inverse.T @ inverse)


class Batch(NamedTuple):
    """Groups of one size d, with what is needed of them at once."""

    groups: Indices  # (g,) their places in the list of groups
    columns: Indices  # (g, d)
    blocks: Array  # (n, g, d, d) [1 per coefficient, squared] own products per joint
    spread: Array  # (g, d, d) [units of the coefficients]
    mean: Array  # (g,) [1]
    first: Array  # (g, d) [units of the coefficients] spread of the positive coefficient, NaN where none is


@dataclass(frozen=True, eq=False)
class Evidence(Frozen):
    """Rows that can be asked what any hypothesis adds to others that are taken for true."""

    data: Whitened

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
        data, refitted = self.data, [g for g in self.data.refitted if trust > 0 or not g.bodies]
        which = columns_of([*refitted, *true])
        gram = self._rows(which, true) / dispersion[:, None, None]
        gram, right = gram.sum(0), (data.right / dispersion[:, None]).sum(0)
        precision = self._precision(refitted, true, np.diag(gram[:, which]), trust)
        whole = gram[:, which] + precision
        size = np.sqrt(np.diag(whole))
        lower = np.linalg.cholesky(whole / size / size[:, None] + 1e-11 * np.eye(len(size)))
        told = solve_triangular(lower, right[which] / size, lower=True)
        half = np.linalg.slogdet(precision)[1] / 2 - float(np.sum(np.log(np.diag(lower)) + np.log(size)))
        across = solve_triangular(lower, gram / size[:, None], lower=True)
        return Fitted(which, lower, size, across, told, float(told @ told) / 2 + half)

    def weigh(self, true: Sequence[Group], dispersion: Array) -> tuple[Array, Array]:
        """Log Bayes factor of every group (NaN for those that are refitted or true), and the weight of each trust.

        Args:
            true: hypotheses that are taken for true.
            dispersion: (n,) variance of the whitened residual [1].
        """
        fits = [self.fit(true, dispersion, trust) for trust in TRUST]
        weight = TRUST_PRIOR + np.array([fit.log_evidence for fit in fits])
        weight = weight - logsumexp(weight)
        factors = np.array([self._factors(fit, dispersion) for fit in fits])
        factors[:, [k for k, group in enumerate(self.data.groups) if group in set(true)]] = np.nan
        return np.asarray(logsumexp(factors + weight[:, None], axis=0)), np.exp(weight)

    def ask(self, fit: Fitted, dispersion: Array, belief: Belief, columns: Mapping[int, Array]) -> float:
        """Log Bayes factor of columns that are not among the rows' own.

        Args:
            fit: everything that is refitted or taken for true.
            dispersion: (n,) variance of the whitened residual [1].
            belief: of the coefficients.
            columns: per joint (M, d) whitened [1 per coefficient].
        """
        d = len(belief.spread)
        own, right, across = np.zeros((d, d)), np.zeros(d), np.zeros((len(fit.which), d))
        for j, x in columns.items():
            here = np.isin(fit.which, self.data.place[j])
            beside = self.data.columns[j][:, np.searchsorted(self.data.place[j], fit.which[here])]
            own += x.T @ x / dispersion[j]
            right += x.T @ self.data.residual[j] / dispersion[j]
            across[here] += beside.T @ x / dispersion[j]
        across = solve_triangular(fit.lower, across / fit.size[:, None], lower=True)
        first = belief.spread[belief.positive] if belief.positive >= 0 else belief.spread[0] * np.nan
        none, empty = np.zeros(1, dtype=np.intp), np.zeros(0)
        batch = Batch(none, none, empty, belief.spread[None], np.array([belief.mean]), first[None])
        return float(_log_factor(batch, (own - across.T @ across)[None], (right - across.T @ fit.told)[None])[0])

    def trust(self, true: Sequence[Group], dispersion: Array) -> float:
        """The likeliest distrust of the inertials.

        Args:
            true: hypotheses that are taken for true.
            dispersion: (n,) variance of the whitened residual [1].
        """
        told = [self.fit(true, dispersion, trust).log_evidence for trust in TRUST]
        return float(TRUST[int(np.argmax(told + TRUST_PRIOR))])

    def _rows(self, which: Indices, true: Sequence[Group]) -> Array:
        """(n, k, p) products of the columns that are fitted."""
        refitted = columns_of(self.data.refitted)
        known = self.data.refitted_gram[:, np.isin(refitted, which)]
        return np.concatenate([known, *(self._gram_of(group) for group in true)], axis=1)

    def _gram_of(self, group: Group) -> Array:
        if group not in self._seen:
            self._seen[group] = self.data.gram(columns_of([group]))
        return self._seen[group]

    @cached_property
    def _seen(self) -> dict[Group, Array]:
        return {}

    def _precision(self, refitted: Sequence[Group], true: Sequence[Group], diagonal: Array, trust: float) -> Array:
        """(k, k) of the prior."""
        deviation = np.concatenate(
            [np.array(g.deviation) * (trust if g.bodies else 1.0) for g in refitted] or [np.zeros(0)]
        )
        flat = FLAT * np.maximum(diagonal[: len(deviation)], 1e-12)
        out = np.zeros((len(diagonal), len(diagonal)))
        at = len(deviation)
        out[range(at), range(at)] = np.where(np.isinf(deviation), flat, deviation**-2.0)
        for group in true:
            belief = self.beliefs[group]
            assert belief is not None, "what does not show is never taken for true"
            size = 1.0 if belief.mean else WIDE
            covariance = size**2 * belief.spread @ belief.spread.T
            scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
            inverse = np.linalg.inv(covariance / scale / scale[:, None] + 1e-9 * np.eye(group.size))
            out[at : at + group.size, at : at + group.size] = inverse / scale / scale[:, None]
            at += group.size
        return out

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

    def _factors(self, fit: Fitted, dispersion: Array) -> Array:
        """(groups,) log Bayes factors at one trust."""
        right = (self.data.right / dispersion[:, None]).sum(0) - fit.across.T @ fit.told
        out = np.full(len(self.data.groups), np.nan)
        for batch in self._batches:
            across = fit.across.T[batch.columns]  # (g, d, k)
            own = np.tensordot(1 / dispersion, batch.blocks, axes=1) - across @ across.transpose(0, 2, 1)
            out[batch.groups] = _log_factor(batch, own, right[batch.columns])
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
