"""Bayes factors and priors -> the posterior odds of every hypothesis, shapes averaged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..types import Array, Frozen
from .evidence import Evidence
from .group import Group
from .hypothesis import Key
from .prior import NOTHING, likely


class Odds(NamedTuple):
    """Of one hypothesis, whatever its shape."""

    log: float  # log posterior odds against nothing more
    best: Group  # the likeliest shape


@dataclass(frozen=True, eq=False)
class Judge(Frozen):
    """The library with its priors, and the evidence."""

    evidence: Evidence
    kinds: int  # effects of the library, those left out too
    skipped: int
    carried: tuple[int, ...]  # (n,) which body each joint moves

    @cached_property
    def keys(self) -> dict[Key, list[int]]:
        """Members of each grid of shapes, as places in the list of groups."""
        out = dict[Key, list[int]]()
        for k, group in enumerate(self.evidence.data.groups):
            if group.hypothesis is not None and self.evidence.beliefs[group] is not None:
                out.setdefault(group.hypothesis.key, []).append(k)
        return out

    def parts(self, group: Group) -> tuple[Group, ...]:
        """The hypotheses of its single laws, where it has several."""
        laws = group.claim.laws
        found = self.alone([(law.effect.name, law.joints) for law in laws])
        return found if len(laws) > 1 and len(found) == len(laws) else (group,)

    def alone(self, keys: Sequence[Key]) -> tuple[Group, ...]:
        """The hypotheses of single laws without a shape at some places, as far as there are."""
        return tuple(self.evidence.data.groups[self.keys[key][0]] for key in keys if key in self.keys)

    @cached_property
    def priors(self) -> dict[Key, float]:
        """Log prior probability of each."""
        groups = self.evidence.data.groups
        unknowns = sum(groups[which[0]].claim.unknown for which in self.keys.values())
        places = dict[str, int]()
        for name, _ in self.keys:
            places[name] = places.get(name, 0) + 1
        return {
            key: likely(groups[which[0]].claim, places[key[0]], self.skipped, self.kinds, max(unknowns, 1))
            for key, which in self.keys.items()
        }

    def odds(self, true: Sequence[Group], dispersion: Array) -> tuple[dict[Key, Odds], float]:
        """Of everything that is not yet taken for true, and the probability that the inertials are trusted.

        Args:
            true: hypotheses that are taken for true.
            dispersion: (n,) variance of the whitened residual [1].
        """
        factors, trust = self.evidence.weigh(true, dispersion)
        taken = {group.claim.key for group in true}
        out = dict[Key, Odds]()
        for key, which in self.keys.items():
            told = factors[which]
            if key in taken or not np.isfinite(told).any():
                continue
            told = np.where(np.isfinite(told), told, -np.inf)
            best = int(np.argmax(told))
            mean = told[best] + np.log(np.mean(np.exp(told - told[best])))
            out[key] = Odds(float(mean + self.priors[key] - np.log(NOTHING)), self.evidence.data.groups[which[best]])
        return out, float(trust[0])
