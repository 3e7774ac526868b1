"""Bayes factors and priors -> the posterior odds of every hypothesis, shapes averaged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...types import Array, BaseMap, Frozen, Indices
from ..data.column_groups import Group
from ..data.hypotheses import Hypothesis, Key
from ..data.normal_equations import Fitted
from ..data.whitened_rows import mean_products
from .bayes_factors import Evidence
from .prior import coefficient_prior, log_prior
from .thresholds import PRIOR_NOTHING

Columns = Mapping[int, Array]


class Odds(NamedTuple):
    """Of one hypothesis, whatever its shape."""

    log: float  # log posterior odds against nothing more
    best: Group  # the likeliest shape


class _Grids(NamedTuple):
    """The m grids of shapes, one after another."""

    members: Indices  # (g,) places in the list of groups
    starts: Indices  # (m,) of each grid among these
    counts: Indices  # (m,) members of each
    priors: Array  # (m,) log prior probabilities


class StatedBodies(NamedTuple):
    """Rigid bodies of the simulation, to see whether a change of one is possible."""

    base: BaseMap
    inertials: Array  # (nb, 10) in Pinocchio's order [kg, kg.m, kg.m2]


@dataclass(frozen=True, eq=False)
class Posterior(Frozen):
    """The library with its priors, and the evidence."""

    evidence: Evidence
    kinds: int  # effects of the library, those left out too
    skipped: int
    carried: tuple[int, ...]  # (n,) which body each joint moves
    bodies: StatedBodies | None = None  # of the simulation; None: any change of them counts as possible

    @cached_property
    def feasibility(self) -> dict[Group, list[tuple[Array, bool]]]:
        """Numbers of changes of bodies, and whether real bodies could have them, as far as was asked."""
        return {}

    @cached_property
    def keys(self) -> dict[Key, list[int]]:
        """Members of each grid of shapes, as places in the list of groups."""
        out = dict[Key, list[int]]()
        for k, group in enumerate(self.evidence.data.groups):
            if group.hypothesis is not None and self.evidence.coefficient_priors[group] is not None:
                out.setdefault(group.hypothesis.key, []).append(k)
        return out

    def parts(self, group: Group) -> tuple[Group, ...]:
        """The hypotheses of its single laws, where it has several."""
        laws = group.claim.laws
        found = self.single_laws([(law.effect.name, law.joints) for law in laws])
        return found if len(laws) > 1 and len(found) == len(laws) else (group,)

    def single_laws(self, keys: Sequence[Key]) -> tuple[Group, ...]:
        """The hypotheses of single laws without a shape at some places, as far as there are."""
        return tuple(self.evidence.data.groups[self.keys[key][0]] for key in keys if key in self.keys)

    def counterpart(self, group: Group) -> Group:
        """The first of the shapes of a hypothesis among these rows that has as many coefficients.

        Args:
            group: a hypothesis of other rows.
        """
        shapes = [self.evidence.data.groups[k] for k in self.keys[group.claim.key]]
        return next((own for own in shapes if own.size == group.size), shapes[0])

    @cached_property
    def _grids(self) -> _Grids:
        counts = np.array([len(which) for which in self.keys.values()], dtype=np.intp)
        members = np.array([k for which in self.keys.values() for k in which], dtype=np.intp)
        return _Grids(members, np.cumsum(counts) - counts, counts, np.array([self.priors[key] for key in self.keys]))

    @cached_property
    def priors(self) -> dict[Key, float]:
        """Log prior probability of each."""
        groups = self.evidence.data.groups
        return {key: self._prior(groups[which[0]].claim) for key, which in self.keys.items()}

    def candidate_log_odds(
        self, fit: Fitted, dispersion: Array, hypothesis: Hypothesis, torque: Columns, white: Columns
    ) -> float | None:
        """Log posterior odds of a hypothesis that is not among the rows' own; None where the motion does not show it.

        Args:
            fit: everything that is refitted or taken for true.
            dispersion: (n,) variance of the whitened residual [1].
            hypothesis: which.
            torque: its columns, per joint (M, d) [torque per coefficient].
            white: the same in units of the noise, per joint (M', d) [1 per coefficient].
        """
        prior = coefficient_prior(hypothesis, mean_products(torque, self.evidence.data.scale))
        if prior is None:
            return None
        return (
            self.evidence.candidate_log_factor(fit, dispersion, prior, white)
            + self._prior(hypothesis)
            - float(np.log(PRIOR_NOTHING))
        )

    def _prior(self, hypothesis: Hypothesis) -> float:
        places = max(1, self._places.get(hypothesis.key[0], 0))
        return log_prior(hypothesis, places, self.skipped, self.kinds, self._places.get("", 1))

    @cached_property
    def _places(self) -> dict[str, int]:
        """Of each effect, and under no name of all that is unknown."""
        groups, out = self.evidence.data.groups, dict[str, int]()
        for key, which in self.keys.items():
            for name in (key[0], *([""] if groups[which[0]].claim.unknown else [])):
                out[name] = out.get(name, 0) + 1
        return out

    def odds(
        self, selected: Sequence[Group], dispersion: Array, without: Group | None = None
    ) -> tuple[dict[Key, Odds], float]:
        """Of everything that is not yet taken for true, and the probability that the inertials are trusted.

        Args:
            selected: selected hypotheses.
            dispersion: (n,) variance of the whitened residual [1].
            without: one of them that is not, after all.
        """
        factors, prior_scale = self.evidence.log_bayes_factors(selected, dispersion, without)
        grids, taken = self._grids, {group.claim.key for group in selected if group is not without}
        told = np.where(np.isfinite(factors), factors, -np.inf)[grids.members]
        highest = np.maximum.reduceat(told, grids.starts)
        shown = np.isfinite(highest)
        share = np.exp(told - np.repeat(np.where(shown, highest, 0.0), grids.counts))
        best = np.flatnonzero(told == np.repeat(highest, grids.counts))
        first = best[np.searchsorted(best, grids.starts)]
        mean = np.where(shown, np.add.reduceat(share, grids.starts) / grids.counts, 1.0)
        log = highest + np.log(mean) + grids.priors - np.log(PRIOR_NOTHING)
        groups, out = self.evidence.data.groups, dict[Key, Odds]()
        for key, yes, value, which in zip(self.keys, shown, log.tolist(), grids.members[first].tolist(), strict=True):
            if yes and key not in taken:
                out[key] = Odds(value, groups[which])
        return out, float(prior_scale[0])
