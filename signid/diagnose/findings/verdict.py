"""Odds, sizes and what is left -> whether something is missing, and whether it could be named."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...regression.projection import leave
from ...types import Array, Frozen, Mask
from ..data.column_groups import Group
from ..data.dataset import Dataset
from ..data.noise import has_full_window
from ..data.whitening import weights
from ..evidence.posterior_odds import Posterior
from ..evidence.selection import Selection
from ..search.contributions import Sizes, measure_sizes
from .contender import Contender

CAUSE = 0.15  # of the largest ratio of torque to residual: less is a small correction
LARGE, HOLDS = 0.03, 0.2  # share of some joint's torque, and held-out gain: more is no small correction
NOTICEABLE = 0.01  # of torque: a discrepancy that follows the joint's state and is larger is something missing
EXPLAINED, ROUGHLY = 0.6, 0.5  # of the excess, of plain laws and of those whose shape is approximate
NOTICED = 4.0  # standard deviations of a mean square
DISCREPANCY = 0.006  # of torque, in which every simulation is wrong
FAINT = 0.1  # of the largest rms torque: no joint's counts as smaller
CLEAR, CLEARLY = 20.0, 0.8  # log odds that a variable explains it, from which on so much of the threshold is enough
PLAIN = 3.0  # times the threshold, from which on something is missing though it depends on no variable
STAYS = 0.25  # of a joint's excess that causes at other joints leave: they are not what is missing there
LEFT = 0.1  # of the largest excess: less does not matter


@dataclass(frozen=True, eq=False)
class Verdict(Frozen):
    """What the recordings say as a whole."""

    name: str  # nothing_missing, named or unknown
    causes: tuple[Group, ...]
    secondary: tuple[Group, ...]
    before: Array  # (n,) excess of the whitened sum of squares [1]
    after: Array  # (n,) [1]
    threshold: Array  # (n,) of the excess [1]
    sizes: Sizes

    def without(self, weak: Collection[Group]) -> Verdict:
        """Without hypotheses that held-out rows speak against; where no cause stays, unknown or nothing missing.

        Args:
            weak: these hypotheses.
        """
        causes, secondary = (tuple(g for g in some if g not in weak) for some in (self.causes, self.secondary))
        bare = "unknown" if np.any(self.before > self.threshold) else "nothing_missing"
        name = bare if self.name == "named" and not causes else self.name
        return replace(self, name=name, causes=causes, secondary=secondary)

    def is_quiet(self, joints: Sequence[int]) -> bool:
        """Whether the simulation as given leaves no more at some joints than noise and the usual model error.

        Args:
            joints: their indices.
        """
        return bool(np.all(self.before[list(joints)] <= self.threshold[list(joints)]))

    def with_promoted(self, contenders: Sequence[Contender], gains: Mapping[Group, float]) -> Verdict:
        """With what is no small correction beside a larger cause among the causes.

        Args:
            contenders: how sure each is.
            gains: share of the held-out sum of squares, on its joints, that each takes away [1].
        """
        sure = {contender.group for contender in contenders if contender.probability > 0.5}
        size = self.sizes.share
        more = [g for g in self.secondary if g in sure and size[g].max() >= LARGE and gains[g] >= HOLDS]
        if self.name != "named" or not more:
            return self
        secondary = tuple(group for group in self.secondary if group not in more)
        return replace(self, causes=(*self.causes, *more), secondary=secondary)

    def with_demoted(self, kept: Collection[Group]) -> Verdict:
        """With causes that held-out rows speak against behind the others: among the corrections, if there are others.

        Args:
            kept: the hypotheses that they speak for.
        """
        causes = tuple(group for group in self.causes if group in kept)
        refused = tuple(group for group in self.causes if group not in kept)
        return replace(self, causes=causes, secondary=(*refused, *self.secondary)) if causes else self


def decide(dataset: Dataset, found: Selection, contenders: Sequence[Contender]) -> Verdict:
    """Named, unknown, or nothing missing.

    Args:
        dataset: rows.
        found: the selected laws.
        contenders: how sure each is.
    """
    data, noise = found.data, dataset.noise
    sizes = measure_sizes(found.evidence, found.selected, found.dispersion, found.prior_scale)
    bare = measure_sizes(found.evidence, (), found.dispersion, found.evidence.prior_scale((), found.dispersion))
    count = data.counts
    rest, plain = (dataset.remaining(data, one.fit) for one in (sizes, bare))
    after, before = (_excess(dataset, count, one) for one in (rest, plain))
    scale = np.maximum(data.scale, FAINT * data.scale.max())
    unknown = (o for o in found.first.values() if o.best.claim.unknown and np.any(before[data.rows(o.best)] > 0))
    clear = max((o.log for o in unknown), default=-np.inf)
    threshold = NOTICED * np.sqrt(2 * count) + count * (DISCREPANCY * scale / noise.saturated_floor) ** 2
    threshold = threshold * (CLEARLY if clear > CLEAR and not found.selected else 1.0)
    energy = {group: _weight(found.posterior, sizes, rest, group) for group in found.selected}
    largest = max(energy.values(), default=0.0)
    contender = {contender.group: contender for contender in contenders}
    ranked = sorted(found.selected, key=lambda group: (contender[group].log_at_scale < 0, -energy[group]))
    causes = tuple(group for group in ranked if energy[group] >= CAUSE * largest)
    secondary = tuple(group for group in ranked if group not in causes)
    if not causes:
        state = clear > 0 or np.any(noise.discrepancy > NOTICEABLE * scale)
        differs = clear > CLEAR or np.any(after > threshold * (1 if state else PLAIN))
        name = "unknown" if differs else "nothing_missing"
    elif _abstains(data.joints, causes, (before, after, threshold), contender[causes[0]]):
        name = "unknown"
    else:
        name = "named"
    return Verdict(name, causes, secondary, before, after, threshold, sizes)


def _excess(dataset: Dataset, counts: Array, rest: Array) -> Array:
    """(n,) sum of squares of the residual, discrepancy included, beyond that of the floor [variance of the floor]."""
    noise = dataset.noise
    weight, order = weights(dataset.table, noise), noise.coefficients.shape[1]
    kept = has_full_window(dataset.table.piece, order)
    return np.asarray(np.sum((rest[order:][kept] * weight / noise.saturated_floor) ** 2, axis=0) - counts)


def _weight(posterior: Posterior, sizes: Sizes, rest: Array, group: Group) -> float:
    """How much a law matters [1]: its mean square torque over that of what all leave, and over that of all torque.

    Only the part of its torque counts that no other law could make, since two laws may cancel most of each other, and
    at most what would be left in addition without it. Bodies count as found, since they may not be of any size. A
    geometric mean of both ratios, summed over joints.

    Args:
        posterior: odds of every hypothesis.
        sizes: of the selected laws.
        rest: (M, n) what all laws together leave [N.m or N].
        group: one of them.
    """
    data, size = posterior.evidence.data, 0.0
    for j in data.rows(group):
        torque, left = data.raw(j, group) @ sizes.value[group], float(np.mean(rest[:, j] ** 2))
        beside = [(g, x) for g, x in sizes.value.items() if g is not group and j in data.rows(g)]
        others = [data.raw(j, g) @ x if g.claim.bodies else data.raw(j, g) for g, x in beside]
        alone = leave(torque, np.column_stack(others)) if others else torque
        more = max(float(np.mean((rest[:, j] + torque) ** 2)) - left, 0.0)
        size += min(more, float(np.mean(alone**2))) / max(float(np.sqrt(left)) * data.scale[j], 1e-300)
    return float(np.sqrt(size))


def _abstains(joints: int, causes: Sequence[Group], excess: tuple[Array, Array, Array], first: Contender) -> bool:
    """Whether the causes leave most of what differs, at their joints or elsewhere."""
    before, after, threshold = excess
    concerned = np.zeros(joints, dtype=bool)
    for group in causes:
        concerned |= _concerned(group, before > threshold)
    left, whole = np.maximum(after, 0)[concerned].sum(), np.maximum(before, 0)[concerned].sum()
    needed = ROUGHLY if causes[0].claim.laws[0].effect.approximate else EXPLAINED
    loud = concerned & (after > threshold) & (after > LEFT * before.max())
    if 1 - left / max(whole, 1e-9) < needed and loud.any():
        return True
    elsewhere = ~concerned & (after > PLAIN * threshold) & (after > STAYS * before)
    return first.unknown > 0.5 or bool(after[elsewhere].sum() > max(whole - left, 0.0))


def _concerned(group: Group, loud: Mask) -> Mask:
    """(n,) the joints whose residual an effect should explain."""
    out = np.zeros(len(loud), dtype=bool)
    for law in group.claim.laws:
        if law.effect.scope != "joint":
            out |= loud
        out[list(law.joints) if len(law.joints) <= 2 else []] = True
    return out
