"""A selected law, its rivals, the probability of each, and the torque that rivals cannot make."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...regression.projection import RANK, leave
from ...types import Array, Frozen
from ..data.column_groups import Group
from ..data.hypotheses import Key
from ..evidence.selection import Odds, Posterior
from ..search.contributions import Contributions
from .thresholds import COMPARED_LOG_ODDS, SAME_TORQUE_CHI2

CLIP = 500.0  # log odds beyond which a probability is 0 or 1 in double precision [-]


@dataclass(frozen=True, eq=False)
class Contender(Frozen):
    """A selected law m and its rivals.

    The probability of m is that of some law in its place, times that of m given that there is one:

        P(m) = 1 / (1 + exp(-L)) s_m,      L = min(min(E, u) + H, u, r),      s_m = exp(o_m) / sum over r of exp(o_r)

    with E the log posterior odds of the training rows, H the log Bayes factor of the held-out rows, u the limit by an
    unsteady gain or by joints that moved in step, r = 0 where the law is refused, else infinite, and o the log odds of
    every hypothesis in the place of m.
    """

    group: Group
    evidence: float  # E [-]
    shares: Mapping[Key, float]  # s of the law and of its rivals [1]
    candidates: Mapping[Key, Group]  # rivals to list, the most probable first
    unexplained: float  # share s of dependences without law [1]
    instead: Group | None = None  # most probable rival, where it is clearly more probable than the law
    steadiness: float = np.inf  # u [-]
    held_out: float = 0.0  # H [-]
    refused: bool = False  # whether held-out rows speak against the law, or its numbers are vague: r = 0
    log_at_scale: float = np.inf  # o of the law at k^2 times the variance, see `rank_contenders` [-]

    def with_held_out(self, log_bayes: float, refused: bool) -> Contender:
        """Add the log Bayes factor H of the held-out rows [-], and whether the law is refused: r = 0."""
        return replace(self, held_out=log_bayes, refused=refused)

    @property
    def log(self) -> float:
        """Log odds L that some law is in its place [-]."""
        most = min(self.steadiness, 0.0) if self.refused else self.steadiness
        return min(min(self.evidence, self.steadiness) + self.held_out, most)

    @property
    def probability(self) -> float:
        """P(m) [1]."""
        return self._any_law * self.shares.get(self.group.claim.key, 0.0)

    @property
    def unknown(self) -> float:
        """Probability that no law of the library is behind it [1]."""
        return self._any_law * self.unexplained

    @property
    def rivals(self) -> dict[Key, tuple[float, Group]]:
        """Probability of each rival to list [1], and its most probable shape."""
        return {key: (self._any_law * self.shares[key], group) for key, group in self.candidates.items()}

    @property
    def _any_law(self) -> float:
        return 1 / (1 + float(np.exp(-np.clip(self.log, -CLIP, CLIP))))


def residual_energies(
    posterior: Posterior, group: Group, odds: Mapping[Key, Odds], contributions: Contributions
) -> dict[Key, float]:
    """Sum of squares of a law's torque that each rival cannot make [variance of noise]; under the law's own key, all.

    Rivals far behind the law, or elsewhere, are left out.
    """
    data, own = posterior.evidence.data, group.claim.key
    joints = set(data.rows(group))
    torque = {j: data.part(j, group) @ contributions.coefficients[group] for j in range(data.joints)}
    energy = {j: float(x @ x) for j, x in torque.items()}
    least = odds[own].log - COMPARED_LOG_ODDS if own in odds else -np.inf
    out = {own: max(sum(energy.values()), 1e-300)}
    for key, rival in odds.items():
        twin, acted_on = _is_twin(posterior, group, rival.best), data.rows(rival.best)
        if rival.best.claim.unknown or (rival.log < least and not twin) or joints.isdisjoint(acted_on):
            continue
        elsewhere = sum(x for j, x in energy.items() if j not in acted_on)
        if key != own and (twin or elsewhere < SAME_TORQUE_CHI2):
            out[key] = elsewhere + _residual_energy(posterior, rival.best, torque)
    return out


def _is_twin(posterior: Posterior, group: Group, rival: Group) -> bool:
    """Whether a rival at the same place is nearly indistinguishable at any size, as its effect states."""
    if rival.claim.key[1] != group.claim.key[1] or rival.claim.kind not in group.claim.laws[0].effect.twins:
        return False
    prior = posterior.evidence.coefficient_priors[rival]
    return prior is not None and not prior.mean


def _residual_energy(posterior: Posterior, rival: Group, torque: Mapping[int, Array]) -> float:
    """Sum of squares of a torque, on the rival's joints, that it and refitted laws cannot make [variance of noise]."""
    data, prior = posterior.evidence.data, posterior.evidence.coefficient_priors[rival]
    joints = data.rows(rival)

    def stacked(group: Group) -> Array:
        return np.concatenate([data.part(j, group) for j in joints])

    own, target = stacked(rival), np.concatenate([torque[j] for j in joints])
    if prior is not None and prior.mean:  # a law without numbers has its full torque
        target, own = target - own.sum(axis=1), own[:, :0]
    shared = [group for group in data.refitted if not group.bodies and len(data.rows(group)) > 1]
    columns = np.concatenate([own, *map(stacked, shared)], axis=1)
    parts = zip(joints, np.split(np.column_stack([target, columns]), len(joints)), strict=True)
    free = np.concatenate([data.free(j, part) for j, part in parts])
    independent = np.linalg.norm(free[:, 1:], axis=0) > RANK * np.linalg.norm(columns, axis=0)
    return float(np.sum(leave(free[:, 0], free[:, 1:][:, independent]) ** 2))
