"""Odds, sizes and what is left -> whether something is missing, and whether it could be named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..types import Array, Frozen, Mask
from .found import Found
from .group import Group
from .odds import Judge
from .sizes import Sizes, measure_sizes
from .slots import Slot

CAUSE = 0.05  # of the largest energy: less is a small correction
LARGE, HOLDS = 0.03, 0.2  # share of some joint's torque, and held-out gain: more is no small correction
EXPLAINED, ROUGHLY = 0.75, 0.5  # of the excess, of plain laws and of those whose shape is approximate
NOTICED = 4.0  # standard deviations of a mean square
DISCREPANCY = 0.006  # of torque, in which every simulation is wrong
FAINT = 0.1  # of the largest rms torque: no joint's counts as smaller
CROWD, MOST_OF_IT = 3, 0.6  # causes; share of the excess that the first of so many must explain
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

    def raised(self, slots: Sequence[Slot], gains: Mapping[Group, float]) -> Verdict:
        """With what is no small correction beside a larger cause among the causes.

        Args:
            slots: how sure each is.
            gains: share of the held-out sum of squares, on its joints, that each takes away [1].
        """
        sure = {slot.group for slot in slots if slot.probability > 0.5}
        size = self.sizes.share
        more = [g for g in self.secondary if g in sure and size[g].max() >= LARGE and gains[g] >= HOLDS]
        if self.name != "named" or not more:
            return self
        secondary = tuple(group for group in self.secondary if group not in more)
        return replace(self, causes=(*self.causes, *more), secondary=secondary)


def decide(judge: Judge, found: Found, slots: Sequence[Slot]) -> Verdict:
    """Named, unknown, or nothing missing.

    Args:
        judge: library and evidence.
        found: what is taken for true.
        slots: how sure each is.
    """
    data = judge.evidence.data
    sizes = measure_sizes(judge.evidence, found.true, found.base, found.trust)
    bare = measure_sizes(judge.evidence, (), found.base, judge.evidence.trust((), found.base))
    count = data.counts
    after, before = (sizes.left - 1) * count, (bare.left - 1) * count
    scale = np.maximum(data.scale, FAINT * data.scale.max())
    told_of = max((o.log for o in found.first.values() if o.best.claim.unknown), default=-np.inf)
    threshold = NOTICED * np.sqrt(2 * count) + count * (DISCREPANCY * scale / data.floor) ** 2
    threshold = threshold * (CLEARLY if told_of > CLEAR and not found.true else 1.0)
    energy = {group: _weight(judge, found, sizes, group) for group in found.true}
    largest = max(energy.values(), default=0.0)
    ranked = sorted(found.true, key=lambda group: -energy[group])
    causes = tuple(group for group in ranked if energy[group] >= CAUSE * largest)
    secondary = tuple(group for group in ranked if group not in causes)
    told = {slot.group: slot for slot in slots}
    if not causes:
        name = "unknown" if np.any(after > threshold * (1 if told_of > 0 else PLAIN)) else "nothing_missing"
    elif _abstains(data.joints, causes, before, after, threshold, told[causes[0]], energy):
        name = "unknown"
    else:
        name = "named"
    return Verdict(name, causes, secondary, before, after, threshold, sizes)


def _weight(judge: Judge, found: Found, sizes: Sizes, group: Group) -> float:
    """Mean square of the torque that a law explains and nothing else would, in units of the joints' torque [1]."""
    data, fit, total = judge.evidence.data, sizes.fit, 0.0
    rest = measure_sizes(judge.evidence, tuple(g for g in found.true if g is not group), found.base, found.trust)
    for j in data.rows(group):
        here, there = (data.at[j, one.which] for one in (fit, rest.fit))
        now = data.torque[j][:, here[here >= 0]] @ fit.value[here >= 0]
        then = data.torque[j][:, there[there >= 0]] @ rest.fit.value[there >= 0]
        total += float(np.mean((now - then) ** 2)) / float(data.scale[j]) ** 2
    return total


def _abstains(
    joints: int,
    causes: Sequence[Group],
    before: Array,
    after: Array,
    threshold: Array,
    first: Slot,
    energy: dict[Group, float],
) -> bool:
    concerned = np.zeros(joints, dtype=bool)
    for group in causes:
        concerned |= _concerned(group, before > threshold)
    left, whole = np.maximum(after, 0)[concerned].sum(), np.maximum(before, 0)[concerned].sum()
    needed = ROUGHLY if causes[0].claim.laws[0].effect.approximate else EXPLAINED
    loud = concerned & (after > threshold) & (after > LEFT * before.max())
    if 1 - left / max(whole, 1e-9) < needed and loud.any():
        return True
    elsewhere = ~concerned & (after > PLAIN * threshold) & (after > LEFT * before.max()) & (after > STAYS * before)
    if elsewhere.any():
        return True
    crowded = len(causes) >= CROWD and np.any(after > threshold) and left > LEFT * whole
    return first.unknown > 0.5 or bool(crowded and energy[causes[0]] < MOST_OF_IT * max(float(before.sum()), 1e-9))


def _concerned(group: Group, loud: Mask) -> Mask:
    """(n,) the joints whose residual an effect should explain."""
    out = np.zeros(len(loud), dtype=bool)
    for law in group.claim.laws:
        if law.effect.scope != "joint":
            out |= loud
        out[list(law.joints) if len(law.joints) <= 2 else []] = True
    return out
