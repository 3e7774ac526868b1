"""Whitened rows -> how much more likely each hypothesis makes them, in closed form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from ...types import Array
from ..data.column_groups import Group
from ..data.normal_equations import Fitted
from .batches import Batch, View, batches, log_bayes_factor, stack_priors, view
from .components import Component
from .linear_model import Linear
from .prior import CoefficientPrior
from .recent import Recent
from .thresholds import (
    COVARIANCE_SCALES,
    INERTIAL_SCALES,
    INTERVAL_COVARIANCE_SCALES,
    LOG_COVARIANCE_SCALE_PRIOR,
    LOG_INERTIAL_SCALE_PRIOR,
)

CACHED_FACTORS, CACHED_COMPLEMENTS = 256, 16  # answers for some joints that are kept


class Left(NamedTuple):
    """What all that is fitted to some joints leaves of their columns."""

    below: Array  # (k, p) [1 per coefficient] what it makes of them, by the fit's factor
    right: Array  # (p,) [1 per coefficient]
    own: list[Array]  # of each portion (g, d, d) [1 per coefficient, squared]


class Told(NamedTuple):
    """What some joints tell of hypotheses."""

    factors: Array  # (h,) [1] log Bayes factors of those that act on no other joint
    own: list[Array]  # of each portion (g - h, d, d) [1 per coefficient, squared] of those that do
    right: list[Array]  # of each portion (g - h, d) [1 per coefficient]


@dataclass(frozen=True, eq=False)
class Evidence(Linear):
    """Rows that can be asked what any hypothesis adds to others that are selected."""

    def log_bayes_factors(
        self, selected: Sequence[Group], dispersion: Array, without: Group | None = None
    ) -> tuple[Array, Array]:
        """Log Bayes factor of every group (NaN for those that are refitted or true), and the weight of each trust.

        Joints that nothing couples with those where anything changed since they were asked last are not asked again.

        Args:
            selected: selected hypotheses.
            dispersion: (n,) variance of the whitened residual [1].
            without: one of them that is not, after all; to ask so of each in turn costs little more than of one.
        """
        kept = {group for group in selected if group is not without}
        fits = [
            self.fit([group for group in selected if group in kept], dispersion, prior_scale)
            for prior_scale in self.scales
        ]
        weight = self.scale_prior + np.array([fit.log_evidence for fit in fits])
        weight = weight - logsumexp(weight)
        factors = np.array([self._factors(selected, dispersion, prior_scale, without) for prior_scale in self.scales])
        factors = factors + weight[:, None]
        factors[:, [k for k, group in enumerate(self.data.groups) if group in kept]] = np.nan
        return np.asarray(logsumexp(factors, axis=0)), np.exp(weight)

    def prior_scale(self, selected: Sequence[Group], dispersion: Array) -> float:
        """The likeliest distrust of the inertials.

        Args:
            selected: selected hypotheses.
            dispersion: (n,) variance of the whitened residual [1].
        """
        told = [self.fit(selected, dispersion, prior_scale).log_evidence for prior_scale in self.scales]
        return float(self.scales[int(np.argmax(told + self.scale_prior))])

    def distance(self, selected: Sequence[Group], dispersion: Array) -> float:
        """NoiseEstimate scale of the deviations that the model carries, larger ones than in a search included [1].

        Args:
            selected: selected hypotheses.
            dispersion: (n,) variance of the whitened residual [1].
        """
        if not self.informed:
            return self.prior_scale(selected, dispersion)
        return float(
            max(INTERVAL_COVARIANCE_SCALES, key=lambda scale: self.fit(selected, dispersion, scale).log_evidence)
        )

    @property
    def informed(self) -> bool:
        """Whether identification left a covariance."""
        return self.stated_prior is not None

    @property
    def scales(self) -> Array:
        """(s,) how far inertials may be off, over their tolerance or over the deviations that a model carries [1]."""
        return COVARIANCE_SCALES if self.informed else INERTIAL_SCALES

    @property
    def scale_prior(self) -> Array:
        """(s,) log prior probabilities of the scales."""
        return LOG_COVARIANCE_SCALE_PRIOR if self.informed else LOG_INERTIAL_SCALE_PRIOR

    def candidate_log_factor(
        self, fit: Fitted, dispersion: Array, prior: CoefficientPrior, columns: Mapping[int, Array]
    ) -> float:
        """Log Bayes factor of columns that are not among the rows' own.

        Args:
            fit: everything that is refitted or taken for true.
            dispersion: (n,) variance of the whitened residual [1].
            prior: of the coefficients.
            columns: per joint (M, d) whitened [1 per coefficient].
        """
        own, right, across = self.data.products(fit.which, dispersion, columns)
        below = fit.forward(across)
        left = (own - below.T @ below)[None], (right - below.T @ fit.forward_right)[None]
        return float(log_bayes_factor(stack_priors([prior]), *left)[0])

    def _factors(
        self, selected: Sequence[Group], dispersion: Array, prior_scale: float, without: Group | None
    ) -> Array:
        """(groups,) log Bayes factors at one trust."""
        out, asked = np.full(len(self.data.groups), np.nan), np.zeros(len(self.data.groups), dtype=bool)
        own = [np.zeros(batch.priors.covariance_factor.shape) for batch in self._batches]
        right = [np.zeros(batch.columns.shape) for batch in self._batches]
        for component in self.components(selected, prior_scale):
            seen = self._view(component.joints)
            told = self._told(component, dispersion[list(component.joints)], prior_scale, without)
            out[seen.inside], asked[seen.inside] = told.factors, True
            for portion, x, y in zip(seen.portions, told.own, told.right, strict=True):
                own[portion.batch][portion.beyond] += x
                right[portion.batch][portion.beyond] += y
        for batch, x, y in zip(self._batches, own, right, strict=True):
            which = np.flatnonzero(~asked[batch.groups])  # act on joints that are fitted apart
            if len(which):
                out[batch.groups[which]] = log_bayes_factor(batch.priors.some(which), x[which], y[which])
        return out

    def _told(self, component: Component, dispersion: Array, prior_scale: float, without: Group | None) -> Told:
        if without is not None and without in component.selected:
            return self._tell(component, self._left_without(component, dispersion, prior_scale, without))
        key = (component, dispersion.tobytes(), prior_scale)
        return self._tolds(key, lambda: self._tell(component, self._left(component, dispersion, prior_scale)))

    @cached_property
    def _tolds(self) -> Recent[Told]:
        return Recent(CACHED_FACTORS)

    def _tell(self, component: Component, left: Left) -> Told:
        factors, own, right = [np.zeros(0)], list[Array](), list[Array]()
        for portion, square in zip(self._view(component.joints).portions, left.own, strict=True):
            inside, across, beside = portion.inside, portion.across, left.right[portion.columns]
            if len(inside):
                factors.append(log_bayes_factor(portion.priors, square[inside], beside[inside]))
            own.append(square[across])
            right.append(beside[across])
        return Told(np.concatenate(factors), own, right)

    def _left(self, component: Component, dispersion: Array, prior_scale: float) -> Left:
        fit, seen, own = self.part(component, dispersion, prior_scale), self._view(component.joints), list[Array]()
        below = fit.forward(self.across(component, dispersion))
        right = (self.data.right[list(component.joints)][:, seen.columns] / dispersion[:, None]).sum(0)
        for portion in seen.portions:
            across = below.T[portion.columns]  # (g, d, k)
            own.append(np.tensordot(1 / dispersion, portion.blocks, axes=1) - across @ across.transpose(0, 2, 1))
        return Left(below, right - below.T @ fit.forward_right, own)

    def _left_without(self, component: Component, dispersion: Array, prior_scale: float, without: Group) -> Left:
        """What all but one of the hypotheses leaves."""
        key = (component, dispersion.tobytes(), prior_scale)
        left = self._lefts(key, lambda: self._left(component, dispersion, prior_scale))
        fit = self.part(component, dispersion, prior_scale)
        below = fit.forward(np.eye(len(fit.which))[:, fit.place(without)])
        shares = below.T @ left.below  # (d, p) of what it would make of each column
        back = np.linalg.solve(below.T @ below, shares)
        own = [
            x + np.einsum("dgi,dgj->gij", shares[:, portion.columns], back[:, portion.columns])
            for x, portion in zip(left.own, self._view(component.joints).portions, strict=True)
        ]
        return Left(left.below, left.right + back.T @ (below.T @ fit.forward_right), own)

    @cached_property
    def _lefts(self) -> Recent[Left]:
        return Recent(CACHED_COMPLEMENTS)

    @cached_property
    def _batches(self) -> list[Batch]:
        return batches(self.data, self.coefficient_priors)

    def _view(self, joints: tuple[int, ...]) -> View:
        if joints not in self._views:
            self._views[joints] = view(self.data, self._batches, joints)
        return self._views[joints]

    @cached_property
    def _views(self) -> dict[tuple[int, ...], View]:
        return {}
