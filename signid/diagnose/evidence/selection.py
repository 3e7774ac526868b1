"""Posterior odds of every hypothesis, averaged over shapes, and the selected hypotheses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...types import Array, BaseMap, Frozen, Indices
from ..data.dataset import Fitted, Whitened, mean_products
from ..data.hypotheses import Hypothesis, Key
from ..data.rows import Group
from ..thresholds import PRIOR_NOTHING
from .bayes_factors import Evidence
from .prior import coefficient_prior, log_prior

GroupColumns = Mapping[int, Array]
BodyChecks = list[tuple[Array, bool]]  # coefficients (d,) [kg, kg.m, kg.m2] of changes of a body, and whether possible


class Odds(NamedTuple):
    """Posterior odds of one hypothesis, averaged over its shapes."""

    log: float  # log posterior odds against no further law [-]
    best: Group  # most likely shape


class _Grids(NamedTuple):
    """Grids of shapes of the m hypotheses, one after another."""

    members: Indices  # (g,) positions in the list of groups
    starts: Indices  # (m,) first member of each grid
    counts: Indices  # (m,) number of members of each grid
    priors: Array  # (m,) [-] log prior probabilities


class StatedBodies(NamedTuple):
    """Rigid bodies of the simulation, to check whether a change of one is physically possible."""

    base: BaseMap
    inertials: Array  # (nb, 10) in Pinocchio's order [kg, kg.m, kg.m2]


@dataclass(frozen=True, eq=False)
class Posterior(Frozen):
    """Prior of the hypotheses and evidence of the rows."""

    evidence: Evidence
    kinds: int  # number of effects of the library, without those left out
    carried: tuple[int, ...]  # (n,) body that each joint moves
    bodies: StatedBodies | None = None  # bodies of the simulation; None: any change of them counts as possible
    feasibility: dict[Group, BodyChecks] = field(default_factory=dict, init=False)

    @cached_property
    def keys(self) -> dict[Key, list[int]]:
        """Members of each grid of shapes, as positions in the list of groups."""
        out = dict[Key, list[int]]()
        for k, group in enumerate(self.evidence.data.groups):
            if group.hypothesis is not None and self.evidence.coefficient_priors[group] is not None:
                out.setdefault(group.hypothesis.key, []).append(k)
        return out

    def single_laws(self, keys: Sequence[Key]) -> tuple[Group, ...]:
        """Hypotheses of single laws without shapes, for the keys that exist."""
        return tuple(self.evidence.data.groups[self.keys[key][0]] for key in keys if key in self.keys)

    def counterpart(self, group: Group) -> Group:
        """The same hypothesis of other rows in these, or its shape that is closest, with as many coefficients."""
        shapes = [self.evidence.data.groups[k] for k in self.keys[group.claim.key]]
        if same := [own for own in shapes if own.claim == group.claim]:
            return same[0]
        alike = [own for own in shapes if own.size == group.size]
        return min(alike, key=lambda own: _distance(own, group), default=shapes[0])

    @cached_property
    def _grids(self) -> _Grids:
        counts = np.array([len(which) for which in self.keys.values()], dtype=np.intp)
        members = np.array([k for which in self.keys.values() for k in which], dtype=np.intp)
        return _Grids(members, np.cumsum(counts) - counts, counts, np.array([self.priors[key] for key in self.keys]))

    @cached_property
    def priors(self) -> dict[Key, float]:
        """Log prior probability of each hypothesis [-]."""
        groups = self.evidence.data.groups
        return {key: self._prior(groups[which[0]].claim) for key, which in self.keys.items()}

    def candidate_log_odds(
        self, fit: Fitted, dispersion: Array, hypothesis: Hypothesis, torque: GroupColumns, white: GroupColumns
    ) -> float | None:
        """Log posterior odds of a hypothesis whose columns are not in the dataset; None if its columns are zero.

        Columns per joint: torque (M, d) [torque per coefficient], white (M', d) [1 per coefficient].
        `fit` is that of nuisance parameters and selected laws, at a dispersion (n,) [1].
        """
        prior = coefficient_prior(hypothesis, mean_products(torque, self.evidence.data.scale))
        if prior is None:
            return None
        log = self.evidence.candidate_log_factor(fit, dispersion, prior, white) + self._prior(hypothesis)
        return log - float(np.log(PRIOR_NOTHING))

    def _prior(self, hypothesis: Hypothesis) -> float:
        places = max(1, self._places.get(hypothesis.kind, 0))
        return log_prior(hypothesis, places, self.kinds, self._places.get("", 1))

    @cached_property
    def _places(self) -> dict[str, int]:
        """Number of hypotheses of each effect; the empty name stands for all unknown dependences."""
        claims = [self.evidence.data.groups[which[0]].claim for which in self.keys.values()]
        return Counter([*(claim.kind for claim in claims), *("" for claim in claims if claim.unknown)])

    def odds(
        self, selected: Sequence[Group], dispersion: Array, without: Group | None = None
    ) -> tuple[dict[Key, Odds], float]:
        """Posterior odds of all hypotheses not selected, and probability of the first prior scale; dispersion (n,) [1].

        A selected hypothesis may be left out (`without`).
        """
        factors, prior_scale = self.evidence.log_bayes_factors(selected, dispersion, without)
        grids, taken = self._grids, {group.claim.key for group in selected if group is not without}
        log_bayes_factor = np.where(np.isfinite(factors), factors, -np.inf)[grids.members]
        highest = np.maximum.reduceat(log_bayes_factor, grids.starts)
        shown = np.isfinite(highest)
        share = np.exp(log_bayes_factor - np.repeat(np.where(shown, highest, 0.0), grids.counts))
        best = np.flatnonzero(log_bayes_factor == np.repeat(highest, grids.counts))
        first = best[np.searchsorted(best, grids.starts)]
        mean = np.where(shown, np.add.reduceat(share, grids.starts) / grids.counts, 1.0)
        log = highest + np.log(mean) + grids.priors - np.log(PRIOR_NOTHING)
        groups, out = self.evidence.data.groups, dict[Key, Odds]()
        for key, yes, value, which in zip(self.keys, shown, log.tolist(), grids.members[first].tolist(), strict=True):
            if yes and key not in taken:
                out[key] = Odds(value, groups[which])
        return out, float(prior_scale[0])


def _distance(one: Group, other: Group) -> float:
    """Largest relative difference of the shape parameters of two groups of one hypothesis [1]."""
    pairs = [
        (a.parameters[key], b.parameters[key])
        for a, b in zip(one.claim.laws, other.claim.laws, strict=False)
        for key in a.effect.shape(a.parameters)
        if key in b.parameters
    ]
    return max((abs(x - y) / max(abs(x), abs(y), 1e-300) for x, y in pairs), default=0.0)


@dataclass(frozen=True, eq=False)
class Selection(Frozen):
    """Selected hypotheses, with the dispersion and the prior scale that were estimated together with them."""

    posterior: Posterior
    selected: tuple[Group, ...]
    log_odds: Mapping[Group, float]  # log posterior odds of each when it was selected [-]
    dispersion: Array  # (n,) c, variance of the whitened residual [1]
    prior_scale: float  # k: errors of the given simulation, in standard deviations of their prior [1]
    first: Mapping[Key, Odds] = field(default_factory=dict)  # odds of each hypothesis beside the given simulation alone

    @property
    def evidence(self) -> Evidence:
        """Evidence of the rows."""
        return self.posterior.evidence

    @property
    def data(self) -> Whitened:
        """Whitened rows."""
        return self.posterior.evidence.data

    def fit(self) -> Fitted:
        """Maximum a posteriori fit of nuisance parameters and selected laws."""
        return self.evidence.fit(self.selected, self.dispersion, self.prior_scale)

    def reported(self) -> Fitted:
        """The same fit, whose covariance has the whole uncertainty of estimated torque constants."""
        return self.fit()._replace(gains=self.data.gains)

    def with_selected(self, selected: Sequence[Group], log_odds: Mapping[Group, float] | None = None) -> Selection:
        """Replace the selected hypotheses; the prior scale becomes the most likely one beside them."""
        scale = self.evidence.prior_scale(selected, self.dispersion)
        log = self.log_odds if log_odds is None else log_odds
        return replace(self, selected=tuple(selected), log_odds=log, prior_scale=scale)

    def without(self, group: Group) -> Selection:
        """Remove one selected hypothesis."""
        return self.with_selected([other for other in self.selected if other is not group])
