"""Batches of hypotheses of equal size: products of columns, stacked priors, log Bayes factors."""

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
    """Coefficient priors of g hypotheses with d coefficients each."""

    covariance_factor: Array  # (g, d, d) [units of the coefficients] T of each
    mean: Array  # (g, d) [1] mean over standard deviation; if it is not 0, f = 1
    positive: Array  # (g, d) [unit of the coefficient] row of T of the coefficient that must be positive; NaN if none

    def take(self, which: Indices) -> StackedPriors:
        """Priors of some of the hypotheses."""
        return StackedPriors(*(x[which] for x in self))


class Batch(NamedTuple):
    """All hypotheses of one size d."""

    groups: Indices  # (g,) positions in the list of groups
    columns: Indices  # (g, d) column indices
    blocks: Array  # (n, g, d, d) [1 per coefficient, squared] S'S of each joint
    there: Mask  # (n, g) whether a group acts on a joint
    priors: StackedPriors


class Portion(NamedTuple):
    """Hypotheses of a batch that act on at least one of c joints."""

    batch: int  # index of the batch
    columns: Indices  # (g, d) positions among the columns of these joints
    blocks: Array  # (c, g, d, d) [1 per coefficient, squared] S'S of each joint
    inside: Indices  # (h,) those of the g that act on no other joint
    across: Indices  # (g - h,) those of the g that do
    beyond: Indices  # (g - h,) positions of the latter in the batch
    priors: StackedPriors  # priors of the hypotheses inside


class JointView(NamedTuple):
    """Hypotheses and columns of some joints."""

    columns: Indices  # (p,) column indices
    portions: tuple[Portion, ...]
    inside: Indices  # (h,) positions in the list of groups of hypotheses inside, portion by portion


def batches(data: Whitened, priors: Mapping[Group, CoefficientPrior | None]) -> list[Batch]:
    """Batches of all hypotheses whose columns are not zero."""
    by_size = dict[int, list[int]]()
    for k, group in enumerate(data.groups):
        if group.hypothesis is not None and priors[group] is not None:
            by_size.setdefault(group.size, []).append(k)
    return [_batch(data, priors, np.array(which, dtype=np.intp)) for which in by_size.values()]


def joint_view(data: Whitened, whole: Sequence[Batch], joints: Sequence[int]) -> JointView:
    """Portions of all batches for some joints."""
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
                priors=batch.priors.take(which[alone]),
            )
        )
        inside.append(batch.groups[which[alone]])
    return JointView(columns, tuple(portions), np.concatenate(inside))


def stack_priors(priors: Sequence[CoefficientPrior]) -> StackedPriors:
    """Stack the priors of hypotheses of equal size."""
    positive = [b.covariance_factor[b.positive] if b.positive >= 0 else b.covariance_factor[0] * np.nan for b in priors]
    mean = [b.mean / np.diag(b.covariance_factor) if b.mean else np.zeros(len(b.covariance_factor)) for b in priors]
    return StackedPriors(np.array([b.covariance_factor for b in priors]), np.array(mean), np.array(positive))


def log_bayes_factor(priors: StackedPriors, own: Array, right: Array) -> Array:
    """(g,) [-] log Bayes factors, averaged over the sizes f.

    With eigenvalues w of T'AT and components z of T'z in the eigenvectors,

        ln BF(f) = 1/2 sum_k [ f^2 z_k^2 / (1 + f^2 w_k) - ln(1 + f^2 w_k) ],

    plus ln 2 Phi(m / s) if a coefficient must be positive; m and s are its posterior mean and standard deviation.
    own (g, d, d) [1 per coefficient, squared] is A = S'S - S'F (F'F + L)^-1 F'S;
    right (g, d) [1 per coefficient] is z = S'y - S'F (F'F + L)^-1 F'y.
    """
    factor, mean = priors.covariance_factor, priors.mean
    values, vectors = np.linalg.eigh(factor.transpose(0, 2, 1) @ own @ factor)
    w = np.maximum(values, 0)  # (g, d)
    z = np.einsum("gij,gi->gj", vectors, np.einsum("gij,gi->gj", factor, right) + mean)
    f2 = np.where(np.any(mean, axis=1, keepdims=True), 1.0, EFFECT_SIZES) ** 2  # (g, sizes)
    fw = 1 + f2[:, :, None] * w[:, None, :]  # (g, sizes, d)
    log = np.sum(f2[:, :, None] * z[:, None, :] ** 2 / fw - np.log(fw), axis=2) / 2
    row = np.einsum("gi,gij->gj", np.nan_to_num(priors.positive), vectors)
    m = np.sum(row[:, None, :] * f2[:, :, None] * z[:, None, :] / fw, axis=2)
    s = np.sqrt(np.maximum(np.sum(row[:, None, :] ** 2 * f2[:, :, None] / fw, axis=2), 1e-300))
    log = log + np.where(np.isnan(priors.positive[:, :1]), 0.0, np.log(2) + log_ndtr(m / s))
    return np.asarray(np.logaddexp.reduce(log, axis=1) - np.sum(mean**2, axis=1) / 2 - np.log(len(EFFECT_SIZES)))


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
