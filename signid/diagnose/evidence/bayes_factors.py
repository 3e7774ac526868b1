"""Log Bayes factors of all hypotheses in closed form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr, logsumexp

from ...types import Array, Indices, Mask
from .. import thresholds as tuned
from ..data.dataset import Fitted, Whitened
from ..data.rows import Group
from .linear_model import Component, LinearModel, cached
from .prior import CoefficientPrior


class Complement(NamedTuple):
    """Schur complement of the fitted columns F of a component, for all p columns of its joints."""

    below: Array  # (k, p) [1 per coefficient] lower^-1 F'S, lower the Cholesky factor of F'F + L
    right: Array  # (p,) [1 per coefficient] z = S'y - S'F (F'F + L)^-1 F'y
    own: list[Array]  # of each portion (g, d, d) [1 per coefficient, squared] A = S'S - S'F (F'F + L)^-1 F'S


class ComponentFactors(NamedTuple):
    """Contribution of one connected component to the log Bayes factors."""

    inside: Array  # (h,) [-] log Bayes factors of hypotheses that act on no other joint
    own: list[Array]  # of each portion (g - h, d, d) [1 per coefficient, squared] A of those that do
    right: list[Array]  # of each portion (g - h, d) [1 per coefficient] z of those that do


@dataclass(frozen=True, eq=False)
class Evidence(LinearModel):
    """Linear model that also computes the Bayes factor of every hypothesis beside those that are selected."""

    def log_bayes_factors(
        self, selected: Sequence[Group], dispersion: Array, without: Group | None = None
    ) -> tuple[Array, Array]:
        """Log Bayes factor of every group (NaN for nuisance terms and selected ones), and posterior of each scale k.

        Results are cached for each connected component of joints, at a dispersion (n,) [1]. Leaving out each selected
        hypothesis in turn (`without`) reuses one Schur complement.
        """
        kept = [group for group in selected if group is not without]
        fits = [self.fit(kept, dispersion, prior_scale) for prior_scale in self.scales]
        weight = self.scale_prior + np.array([fit.log_evidence for fit in fits])
        weight = weight - logsumexp(weight)
        factors = np.array([self._factors(selected, dispersion, prior_scale, without) for prior_scale in self.scales])
        factors = factors + weight[:, None]
        factors[:, [k for k, group in enumerate(self.data.groups) if group in kept]] = np.nan
        return np.asarray(logsumexp(factors, axis=0)), np.exp(weight)

    def prior_scale(self, selected: Sequence[Group], dispersion: Array) -> float:
        """Maximum a posteriori scale k of the error of the simulation [1]; dispersion (n,) [1] of the residual."""
        logs = [self.fit(selected, dispersion, prior_scale).log_evidence for prior_scale in self.scales]
        return float(self.scales[int(np.argmax(logs + self.scale_prior))])

    def distance(self, selected: Sequence[Group], dispersion: Array) -> float:
        """Most likely scale k for intervals [1] at a dispersion (n,) [1]; with a covariance it may be larger."""
        if not self.informed:
            return self.prior_scale(selected, dispersion)
        logs = [
            self.fit(selected, dispersion, prior_scale).log_evidence for prior_scale in tuned.INTERVAL_COVARIANCE_SCALES
        ]
        return float(tuned.INTERVAL_COVARIANCE_SCALES[int(np.argmax(logs))])

    @property
    def informed(self) -> bool:
        """Whether the simulation has a covariance from identification."""
        return self.stated_prior is not None

    @property
    def scales(self) -> Array:
        """(s,) [1] values of k: errors of the simulation, in standard deviations of their prior."""
        return tuned.COVARIANCE_SCALES if self.informed else tuned.BARE_SCALES if self.bare else tuned.INERTIAL_SCALES

    @property
    def scale_prior(self) -> Array:
        """(s,) [-] log prior probability of each scale."""
        bodies = tuned.LOG_BARE_SCALE_PRIOR if self.bare else tuned.LOG_INERTIAL_SCALE_PRIOR
        return tuned.LOG_COVARIANCE_SCALE_PRIOR if self.informed else bodies

    def candidate_log_factor(
        self, fit: Fitted, dispersion: Array, prior: CoefficientPrior, columns: Mapping[int, Array]
    ) -> float:
        """Log Bayes factor [-] of a candidate beside a fit; its columns are not in the dataset; dispersion (n,) [1].

        Its whitened columns are per joint (M, d) [1 per coefficient].
        """
        own, right, across = self.data.products(fit.which, dispersion, columns)
        below = fit.forward(across)
        left = (own - below.T @ below)[None], (right - below.T @ fit.forward_right)[None]
        return float(log_bayes_factor(stack_priors([prior]), *left)[0])

    def complements(self, selected: Sequence[Group], dispersion: Array, prior_scale: float) -> list[Array]:
        """A of all hypotheses beside those selected: of each batch (g, d, d) [1 per coefficient, squared].

        The dispersion (n,) [1] is that of the whitened residual.
        """
        out = [np.zeros(batch.priors.covariance_factor.shape) for batch in self.batches]
        for component in self.components(selected, prior_scale > 0):
            joints = list(component.joints)
            own = self._complement(component, dispersion[joints], prior_scale).own
            for portion, square in zip(self._view(component.joints).portions, own, strict=True):
                out[portion.batch][self.batches[portion.batch].there[joints].any(axis=0)] += square
        return out

    def _factors(self, selected: Sequence[Group], dispersion: Array, scale: float, without: Group | None) -> Array:
        """(groups,) [-] log Bayes factors at one prior scale; NaN for groups that are no candidates."""
        out, done = np.full(len(self.data.groups), np.nan), np.zeros(len(self.data.groups), dtype=bool)
        own = [np.zeros(batch.priors.covariance_factor.shape) for batch in self.batches]
        right = [np.zeros(batch.columns.shape) for batch in self.batches]
        for component in self.components(selected, scale > 0):
            seen = self._view(component.joints)
            among = component, dispersion[list(component.joints)], scale
            if without is not None and without in component.selected:
                factors = self._reduce(component, self._complement_without(*among, without))
            else:
                factors = self._component_factors(*among)
            out[seen.inside], done[seen.inside] = factors.inside, True
            for portion, x, y in zip(seen.portions, factors.own, factors.right, strict=True):
                own[portion.batch][portion.beyond] += x
                right[portion.batch][portion.beyond] += y
        for batch, x, y in zip(self.batches, own, right, strict=True):
            which = np.flatnonzero(~done[batch.groups])  # hypotheses that act on joints of several components
            if len(which):
                out[batch.groups[which]] = log_bayes_factor(batch.priors.take(which), x[which], y[which])
        return out

    @cached(256, appendable=False)
    def _component_factors(self, component: Component, dispersion: Array, prior_scale: float) -> ComponentFactors:
        return self._reduce(component, self._complement(component, dispersion, prior_scale))

    def _reduce(self, component: Component, complement: Complement) -> ComponentFactors:
        """Log Bayes factors of hypotheses inside a component, and the terms of those that act on others too."""
        factors, own, right = [np.zeros(0)], list[Array](), list[Array]()
        for portion, square in zip(self._view(component.joints).portions, complement.own, strict=True):
            inside, across, beside = portion.inside, portion.across, complement.right[portion.columns]
            if len(inside):
                factors.append(log_bayes_factor(portion.priors, square[inside], beside[inside]))
            own.append(square[across])
            right.append(beside[across])
        return ComponentFactors(np.concatenate(factors), own, right)

    @cached(10, appendable=False)
    def _complement(self, component: Component, dispersion: Array, prior_scale: float) -> Complement:
        """Schur complement of all fitted columns of a component, which is large."""
        fit, seen, own = self.part(component, dispersion, prior_scale), self._view(component.joints), list[Array]()
        below = fit.forward(self.across(component, dispersion))
        right = (self.data.right[list(component.joints)][:, seen.columns] / dispersion[:, None]).sum(0)
        for portion in seen.portions:
            across = below.T[portion.columns]  # (g, d, k)
            own.append(np.tensordot(1 / dispersion, portion.blocks, axes=1) - across @ across.transpose(0, 2, 1))
        return Complement(below, right - below.T @ fit.forward_right, own)

    def _complement_without(self, component: Component, dispersion: Array, scale: float, without: Group) -> Complement:
        """Schur complement of all fitted columns except those of one hypothesis, by a low-rank update."""
        full = self._complement(component, dispersion, scale)
        fit = self.part(component, dispersion, scale)
        below = fit.forward(np.eye(len(fit.which))[:, fit.place(without)])
        shares = below.T @ full.below  # (d, p) coefficients of the hypothesis in the fit of each column
        back = np.linalg.solve(below.T @ below, shares)
        own = [
            x + np.einsum("dgi,dgj->gij", shares[:, portion.columns], back[:, portion.columns])
            for x, portion in zip(full.own, self._view(component.joints).portions, strict=True)
        ]
        return Complement(full.below, full.right + back.T @ (below.T @ fit.forward_right), own)

    @cached_property
    def batches(self) -> list[Batch]:
        """All hypotheses whose columns are not zero, by their number of coefficients."""
        by_size = dict[int, list[int]]()
        for k, group in enumerate(self.data.groups):
            if group.hypothesis is not None and self.coefficient_priors[group] is not None:
                by_size.setdefault(group.size, []).append(k)
        return [_batch(self.data, self.coefficient_priors, np.array(x, dtype=np.intp)) for x in by_size.values()]

    @cached(np.inf, appendable=False)
    def _view(self, joints: tuple[int, ...]) -> JointView:
        """Portions of all batches for some joints."""
        columns, portions, inside = self.data.columns_at(joints)[0], list[Portion](), [np.zeros(0, dtype=np.intp)]
        for k, batch in enumerate(self.batches):
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


def stack_priors(priors: Sequence[CoefficientPrior]) -> StackedPriors:
    """Stack the priors of hypotheses of equal size."""
    positive = [b.covariance_factor[b.positive] if b.positive >= 0 else b.covariance_factor[0] * np.nan for b in priors]
    mean = [b.mean / np.diag(b.covariance_factor) if b.mean else np.zeros(len(b.covariance_factor)) for b in priors]
    return StackedPriors(np.array([b.covariance_factor for b in priors]), np.array(mean), np.array(positive))


def log_bayes_factor(priors: StackedPriors, own: Array, right: Array) -> Array:
    """(..., g) [-] log Bayes factors, averaged over the sizes f.

    With eigenvalues w of T'AT and components z of T'z in the eigenvectors,

        ln BF(f) = 1/2 sum_k [ f^2 z_k^2 / (1 + f^2 w_k) - ln(1 + f^2 w_k) ],

    plus ln 2 Phi(m / s) if a coefficient must be positive; m and s are its posterior mean and standard deviation.
    own (g, d, d) [1 per coefficient, squared] is A = S'S - S'F (F'F + L)^-1 F'S;
    right (..., g, d) [1 per coefficient] is z = S'y - S'F (F'F + L)^-1 F'y.
    """
    factor, mean = priors.covariance_factor, priors.mean
    values, vectors = np.linalg.eigh(factor.transpose(0, 2, 1) @ own @ factor)
    w = np.maximum(values, 0)  # (g, d)
    z = np.einsum("gij,...gi->...gj", vectors, np.einsum("gij,...gi->...gj", factor, right) + mean)[..., None, :]
    f2 = np.where(np.any(mean, axis=1, keepdims=True), 1.0, tuned.EFFECT_SIZES)[:, :, None] ** 2  # (g, sizes, 1)
    fw = 1 + f2 * w[:, None, :]  # (g, sizes, d)
    log = np.sum(f2 * z**2 / fw - np.log(fw), axis=-1) / 2
    signed = np.flatnonzero(~np.isnan(priors.positive[:, 0]))  # those with a coefficient that must be positive
    row = np.einsum("gi,gij->gj", priors.positive[signed], vectors[signed])[:, None, :]
    m = np.sum(row * (f2 * z / fw)[..., signed, :, :], axis=-1)
    s = np.sqrt(np.maximum(np.sum(row**2 * (f2 / fw)[signed], axis=-1), 1e-300))
    log[..., signed, :] += np.log(2) + log_ndtr(m / s)
    return np.asarray(np.logaddexp.reduce(log, axis=-1) - np.sum(mean**2, axis=1) / 2 - np.log(len(tuned.EFFECT_SIZES)))


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
