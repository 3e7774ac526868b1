"""Hypotheses of one size at once: their products, what is believed of them, and how likely each is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr

from ...types import Array, Indices, Mask
from ..data.column_groups import Group
from ..data.whitened_rows import Whitened
from .prior import CoefficientPrior
from .thresholds import EFFECT_SIZES


class StackedPriors(NamedTuple):
    """What is believed of g hypotheses of d coefficients each."""

    covariance_factor: Array  # (g, d, d) [units of the coefficients]
    mean: Array  # (g, d) [1] in units of the spread; where it is not 0, the size does not count
    first: Array  # (g, d) [units of the coefficients] spread of the positive coefficient, NaN where none is

    def some(self, which: Indices) -> StackedPriors:
        """Of some of them."""
        return StackedPriors(*(x[which] for x in self))


class Batch(NamedTuple):
    """Groups of one size d."""

    groups: Indices  # (g,) their places in the list of groups
    columns: Indices  # (g, d)
    blocks: Array  # (n, g, d, d) [1 per coefficient, squared] own products per joint
    there: Mask  # (n, g) whether a group acts on a joint
    priors: StackedPriors


class Portion(NamedTuple):
    """The groups of a batch that act on some of c joints."""

    batch: int  # which
    columns: Indices  # (g, d) where they stand among the columns that these joints have
    blocks: Array  # (c, g, d, d) [1 per coefficient, squared] own products per joint
    inside: Indices  # (h,) which of them act on no other joint
    across: Indices  # (g - h,) which of them do
    beyond: Indices  # (g - h,) places of the latter in the batch
    priors: StackedPriors  # of those inside


class View(NamedTuple):
    """What some joints have of everything."""

    columns: Indices  # (p,)
    portions: tuple[Portion, ...]
    inside: Indices  # (h,) places in the list of groups of those that act on no other joint, portion by portion


def batches(data: Whitened, priors: Mapping[Group, CoefficientPrior | None]) -> list[Batch]:
    """All hypotheses that the motion shows."""
    by_size = dict[int, list[int]]()
    for k, group in enumerate(data.groups):
        if group.hypothesis is not None and priors[group] is not None:
            by_size.setdefault(group.size, []).append(k)
    return [_batch(data, priors, np.array(which, dtype=np.intp)) for which in by_size.values()]


def view(data: Whitened, whole: Sequence[Batch], joints: Sequence[int]) -> View:
    """What some joints have of all batches."""
    columns, portions, inside = data.columns_at(joints)[0], list[Portion](), [np.zeros(0, dtype=np.intp)]
    for k, batch in enumerate(whole):
        own = batch.there[list(joints)].sum(axis=0)
        which = np.flatnonzero(own)
        if not len(which):
            continue
        alone = own[which] == batch.there[:, which].sum(axis=0)
        portions.append(
            Portion(
                batch=k,
                columns=np.searchsorted(columns, batch.columns[which]),
                blocks=batch.blocks[list(joints)][:, which],
                inside=np.flatnonzero(alone),
                across=np.flatnonzero(~alone),
                beyond=which[~alone],
                priors=batch.priors.some(which[alone]),
            )
        )
        inside.append(batch.groups[which[alone]])
    return View(columns, tuple(portions), np.concatenate(inside))


def stack_priors(priors: Sequence[CoefficientPrior]) -> StackedPriors:
    """Of hypotheses of one size."""
    first = [b.covariance_factor[b.positive] if b.positive >= 0 else b.covariance_factor[0] * np.nan for b in priors]
    mean = [b.mean / np.diag(b.covariance_factor) if b.mean else np.zeros(len(b.covariance_factor)) for b in priors]
    return StackedPriors(np.array([b.covariance_factor for b in priors]), np.array(mean), np.array(first))


def log_bayes_factor(priors: StackedPriors, own: Array, right: Array) -> Array:
    """(g,) log Bayes factors, sizes averaged.

    Args:
        priors: of g groups of d columns.
        own: (g, d, d) Gram, less what is fitted beside [1 per coefficient, squared].
        right: (g, d) right side, less what is fitted beside [1 per coefficient].
    """
    spread, mean = priors.covariance_factor, priors.mean
    values, vectors = np.linalg.eigh(spread.transpose(0, 2, 1) @ own @ spread)
    w = np.maximum(values, 0)  # (g, d)
    z = np.einsum("gij,gi->gj", vectors, np.einsum("gij,gi->gj", spread, right) + mean)
    f = np.where(np.any(mean, axis=1, keepdims=True), 1.0, EFFECT_SIZES) ** 2  # (g, sizes)
    fw = 1 + f[:, :, None] * w[:, None, :]  # (g, sizes, d)
    told = np.sum(f[:, :, None] * z[:, None, :] ** 2 / fw - np.log(fw), axis=2) / 2
    first = np.einsum("gi,gij->gj", np.nan_to_num(priors.first), vectors)
    mid = np.sum(first[:, None, :] * f[:, :, None] * z[:, None, :] / fw, axis=2)
    wide = np.sqrt(np.maximum(np.sum(first[:, None, :] ** 2 * f[:, :, None] / fw, axis=2), 1e-300))
    told = told + np.where(np.isnan(priors.first[:, :1]), 0.0, np.log(2) + log_ndtr(mid / wide))
    return np.asarray(np.logaddexp.reduce(told, axis=1) - np.sum(mean**2, axis=1) / 2 - np.log(len(EFFECT_SIZES)))


def _batch(data: Whitened, priors: Mapping[Group, CoefficientPrior | None], which: Indices) -> Batch:
    groups = [data.groups[k] for k in which]
    columns = np.array([np.arange(g.start, g.start + g.size) for g in groups], dtype=np.intp)
    there = data.at[:, columns[:, 0]] >= 0
    blocks = np.zeros((data.joints, *columns.shape, columns.shape[1]))
    for j, here in enumerate(there):
        own = [data.part(j, group) for group, yes in zip(groups, here, strict=True) if yes]
        if own:
            x = np.stack(own)
            blocks[j, here] = x.transpose(0, 2, 1) @ x
    return Batch(which, columns, blocks, there, stack_priors([b for g in groups if (b := priors[g]) is not None]))
