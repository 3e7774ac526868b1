"""Probability of each selected law against its rivals, and replacement of improbable laws."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import softmax

from ...deadline import time_is_up
from ...estimation.excitation import in_step
from ...regression.projection import SINGULAR_VALUE_TOLERANCE, leave
from ...types import Array, Frozen
from .. import thresholds as tuned
from ..data.dataset import Dataset
from ..data.hypotheses import Key
from ..data.rows import Group
from ..evidence.likelihood import Likelihood
from ..evidence.selection import Odds, Posterior, Selection
from ..search.contributions import Contributions, measure_contributions, steadiness
from ..search.stepwise import LAW_SEARCH, is_admissible, is_applicable, present_laws, resolved_violations

_OddsBeside = tuple[Array, Mapping[Key, Odds]]  # (n,) variance of the whitened residual, odds beside all selected laws
DECISIVE_LOG_ODDS = 500.0  # log odds beyond which a probability is 0 or 1 in double precision [-]


def limit_in_step(dataset: Dataset, contenders: Collection[Contender]) -> tuple[Contender, ...]:
    """Limit the probability of laws of joints that moved in step: the state of one joint follows from another's."""
    v = np.concatenate([piece.motion.v for piece in dataset.pieces])
    joints = {joint for group in in_step(v.T @ v / len(v)) for joint in group}
    return tuple(
        replace(one, steadiness=min(one.steadiness, tuned.MAX_IN_STEP_LOG_ODDS)) if _follows(one.group, joints) else one
        for one in contenders
    )


def _follows(group: Group, joints: Collection[int]) -> bool:
    """Whether a law of one or two joints acts on one of some joints, or a law of more joints on these alone."""
    acting = [law.joints for law in group.claim.laws]
    return any(set(own) & set(joints) if len(own) <= 2 else set(own) <= set(joints) for own in acting)


def rank_contenders(dataset: Dataset, selection: Selection) -> tuple[Contender, ...]:
    """Compare each selected law with every hypothesis in its place.

    The odds that a rival would gain in addition to the law are subtracted from its own. If the given model is k times
    further off than its covariance says, or than the tolerance of bodies, laws that explain the same torque are
    compared at k^2 times the variance of the rows: they are formulas of the same kind, with errors of that size.

    Source: Birge, Phys. Rev. 40, 1932 (k); Miller, Dunson, J. Am. Stat. Assoc. 114, 2019 (approximate models).
    """
    ranking = _Ranking(dataset, selection)
    return tuple(ranking.contender(group) for group in selection.selected)


def replace_weak(dataset: Dataset, selection: Selection) -> tuple[Selection, tuple[Contender, ...]]:
    """Drop improbable laws one by one, or replace each by its most probable rival."""
    dropped = set[Key]()  # these do not come back
    for _ in range(tuned.REPLACEMENT_ROUNDS):
        contenders = rank_contenders(dataset, selection)
        least = tuned.CAUSE_PROBABILITY
        weak = [one for one in contenders if one.probability + one.unknown < least or one.instead is not None]
        if time_is_up(LAW_SEARCH) or not weak:
            return selection, contenders
        worst = min(weak, key=lambda contender: contender.probability)
        rest, rival = selection.without(worst.group), worst.instead
        dropped.add(worst.group.claim.key)
        possible = rival is not None and rival.claim.key not in dropped and is_admissible(rest, rival)
        better = [rival] if rival is not None and possible else []
        if not better and worst.probability + worst.unknown > least:
            return selection, contenders
        log_odds = {**selection.log_odds, **dict.fromkeys(better, selection.log_odds[worst.group])}
        selection = selection.with_selected((*rest.selected, *better), log_odds)
    return selection, rank_contenders(dataset, selection)


@dataclass(frozen=True, eq=False)
class _Ranking(Frozen):
    """Comparison of selected laws with their rivals; all that they have in common is computed once."""

    dataset: Dataset
    selection: Selection

    def contender(self, group: Group) -> Contender:
        """Compare one selected law with every hypothesis in its place."""
        selection, own = self.selection, group.claim.key
        odds, logs = self._in_place(group, self._beside[0])
        rest = selection.without(group)
        evidence = (odds[own].log if own in odds else selection.log_odds[group]) + self._penalty(group, rest)
        energy = residual_energies(selection.posterior, group, odds, self._contributions)
        for key in (key for key, o in odds.items() if o.best.claim.unknown):
            logs[key] -= tuned.FORMULA_ERROR**2 / 2 * energy[own]
        limit = max(tuned.RIVAL_RESIDUAL_SHARE * energy[own], tuned.SAME_TORQUE_CHI2)
        same = {key for key, x in energy.items() if key != own and x <= limit}
        at_scale = self._in_place(group, self._beside[1])[1] if len(self._beside) > 1 else {}
        if own in logs and own in at_scale:
            logs |= {key: logs[own] + at_scale[key] - at_scale[own] for key in same & at_scale.keys()}
        logs = _admissible(rest, odds, logs, own)
        shares = dict(zip(logs, softmax(list(logs.values())).tolist(), strict=True))
        any_law = 1 / (1 + float(np.exp(-np.clip(evidence, -DECISIVE_LOG_ODDS, DECISIVE_LOG_ODDS))))
        probability = {key: any_law * share for key, share in shares.items()}
        least, same_torque = tuned.LISTED_PROBABILITY, tuned.SAME_TORQUE_CHI2
        near = {k for k in same & shares.keys() if probability[k] > least or energy[k] < same_torque}
        others = {key: x for key, x in probability.items() if key != own and not odds[key].best.claim.unknown}
        first = max(others, key=lambda key: others[key], default=own)
        needed = max(tuned.REPLACEMENT_RATIO * probability.get(own, 0.0), tuned.CAUSE_PROBABILITY)
        return Contender(
            group=group,
            evidence=evidence,
            shares=shares,
            candidates={key: odds[key].best for key in sorted(shares, key=lambda key: -shares[key]) if key in near},
            unexplained=sum(x for key, x in shares.items() if odds[key].best.claim.unknown),
            instead=odds[first].best if others.get(first, 0.0) > needed else None,
            steadiness=steadiness(selection.posterior, self._contributions, self._residual, group),
            log_at_scale=at_scale.get(own, np.inf),
        )

    def _penalty(self, group: Group, rest: Selection) -> float:
        """Log odds that a law loses because noise and discrepancy may explain its torque; 0 for a violated link [-]."""
        certain = time_is_up(LAW_SEARCH) or resolved_violations(self.selection, rest, group)
        return 0.0 if certain else self._likelihood.penalty(group)

    def _in_place(self, group: Group, beside: _OddsBeside) -> tuple[dict[Key, Odds], dict[Key, float]]:
        """Odds of every hypothesis in the place of a law, and their logs less what each gains beside the law [-]."""
        selection, (dispersion, others) = self.selection, beside
        odds, _ = selection.posterior.odds(selection.selected, dispersion, without=group)
        gain = {key: max(0.0, others[key].log if key in others else 0.0) for key in odds}
        return odds, {key: o.log - gain[key] for key, o in odds.items()}

    @cached_property
    def _beside(self) -> list[_OddsBeside]:
        """Odds beside all laws at the variance of the rows, and at k^2 times it where its errors are k times larger."""
        own = self.selection
        further = (own.evidence.informed or own.evidence.bare) and own.prior_scale > 1
        scales = [1.0, own.prior_scale] if further else [1.0]
        dispersions = [own.dispersion * k**2 for k in scales]
        return [(one, own.posterior.odds(own.selected, one)[0]) for one in dispersions]

    @cached_property
    def _contributions(self) -> Contributions:
        own = self.selection
        return measure_contributions(own.evidence, own.selected, own.dispersion, own.prior_scale)

    @cached_property
    def _likelihood(self) -> Likelihood:
        return Likelihood(self.dataset, self.selection)

    @cached_property
    def _residual(self) -> Array:
        """(M, n) [N.m or N] residual of all selected laws."""
        return self.dataset.remaining(self.selection.data, self._contributions.fit)


def _admissible(rest: Selection, odds: Mapping[Key, Odds], logs: Mapping[Key, float], own: Key) -> dict[Key, float]:
    """Drop rivals that change absent laws, and inadmissible ones near the most probable; dependences always stay."""
    present = present_laws(rest)
    kept = {key for key in logs if key == own or odds[key].best.claim.unknown or is_applicable(odds[key].best, present)}
    logs = {key: x for key, x in logs.items() if key in kept}
    least = max(logs.values()) - tuned.CHECKED_LOG_ODDS
    near = [key for key, x in logs.items() if x > least and key != own and not odds[key].best.claim.unknown]
    inadmissible = [key for key in near if not is_admissible(rest, odds[key].best)]
    return {key: x for key, x in logs.items() if key not in inadmissible}


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
        return 1 / (1 + float(np.exp(-np.clip(self.log, -DECISIVE_LOG_ODDS, DECISIVE_LOG_ODDS))))


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
    least = odds[own].log - tuned.COMPARED_LOG_ODDS if own in odds else -np.inf
    out = {own: max(sum(energy.values()), 1e-300)}
    for key, rival in odds.items():
        claim, acted_on = rival.best.claim, data.rows(rival.best)
        prior = posterior.evidence.coefficient_priors[rival.best]
        twin = claim.key[1] == group.claim.key[1] and claim.kind in group.claim.laws[0].effect.twins
        twin = twin and prior is not None and not prior.mean  # nearly indistinguishable at any size
        if claim.unknown or (rival.log < least and not twin) or joints.isdisjoint(acted_on):
            continue
        elsewhere = sum(x for j, x in energy.items() if j not in acted_on)
        if key != own and (twin or elsewhere < tuned.SAME_TORQUE_CHI2):
            out[key] = elsewhere + _residual_energy(posterior, rival.best, torque)
    return out


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
    independent = np.linalg.norm(free[:, 1:], axis=0) > SINGULAR_VALUE_TOLERANCE * np.linalg.norm(columns, axis=0)
    return float(np.sum(leave(free[:, 0], free[:, 1:][:, independent]) ** 2))
