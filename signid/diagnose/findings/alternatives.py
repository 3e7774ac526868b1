"""Selected hypotheses -> how sure each is, and what else could stand in its place."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...deadline import time_is_up
from ...estimation.excitation import in_step
from ...regression.projection import RANK, leave
from ...types import Array
from ..data.column_groups import Group
from ..data.dataset import Dataset
from ..data.hypotheses import Key
from ..evidence.likelihood import Likelihood
from ..evidence.posterior_odds import Odds, Posterior
from ..evidence.selection import Selection
from ..search.contributions import Sizes, measure_sizes
from ..search.feasible import is_sound
from ..search.inertial_check import relieved
from ..search.steady import steadiness
from ..search.stepwise import SEARCH, is_founded, laws_there
from .contender import CLIP, Contender

NOTABLE = 0.03  # probability from which on a rival is listed
NEAR = 4.0  # log odds behind the likeliest, up to which a rival must be physically possible to count
ROUNDS, DOUBT, LIKELIER = 12, 0.2, 1.5  # of settling; probability of what goes; times as likely, to take its place
FAR = 40.0  # log odds behind an effect that no rival falls that leaves nothing of it
HALF = 0.5  # share of an effect that a rival may leave to be listed
INEXACT = 0.2  # share of a real law's torque that its formula misses
MOST_IN_STEP = float(np.log(0.95 / 0.05))  # log odds of laws of joints that moved in step: a probability of .95
SAME = 4.0  # variance units: what a rival leaves of an effect, up to which nothing tells them apart


class _Rows(NamedTuple):
    """A variance of the rows, and the odds of everything beside all hypotheses at that variance."""

    dispersion: Array  # (n,) variance of the whitened residual [1]
    beside: Mapping[Key, Odds]


def limit_in_step(dataset: Dataset, contenders: Sequence[Contender]) -> tuple[Contender, ...]:
    """Limit the probability of laws of joints that moved in step: the state of one joint follows from another's.

    Args:
        dataset: motions.
        contenders: the selected laws, each with its rivals.
    """
    v = np.concatenate([piece.motion.v for piece in dataset.pieces])
    joints = {joint for group in in_step(v.T @ v / len(v)) for joint in group}
    return tuple(
        replace(one, steadiness=min(one.steadiness, MOST_IN_STEP)) if _follows(one.group, joints) else one
        for one in contenders
    )


def _follows(group: Group, joints: Collection[int]) -> bool:
    """Whether a law of one or two joints acts on one of some joints, or a law of more joints on these alone."""
    acting = [law.joints for law in group.claim.laws]
    return any(set(own) & set(joints) if len(own) <= 2 else set(own) <= set(joints) for own in acting)


def rank_contenders(dataset: Dataset, found: Selection) -> tuple[Contender, ...]:
    """Each in turn against all others in its place; what a rival would gain beside it anyway does not count for it.

    Where the given model is k times further off than its covariance says, laws that explain the same torque are
    compared at k^2 times the variance of the rows: they are formulas of the same kind, with errors of that size.

    Source: Birge, Phys. Rev. 40, 1932 (k); Miller, Dunson, J. Am. Stat. Assoc. 114, 2019 (approximate models).
    """
    scales = [1.0, found.prior_scale] if found.evidence.informed and found.prior_scale > 1 else [1.0]
    rows = [
        _Rows(found.dispersion * k**2, found.posterior.odds(found.selected, found.dispersion * k**2)[0]) for k in scales
    ]
    sizes = measure_sizes(found.evidence, found.selected, found.dispersion, found.prior_scale)
    likelihood = Likelihood(dataset, found.evidence, found)
    rest = dataset.remaining(found.data, sizes.fit)
    contenders = (_contender(found, group, rows, sizes, likelihood) for group in found.selected)
    return tuple(replace(one, steadiness=steadiness(found.posterior, sizes, rest, one.group)) for one in contenders)


def replace_weak(dataset: Dataset, found: Selection) -> tuple[Selection, tuple[Contender, ...]]:
    """Without hypotheses that hardly anything speaks for; the likeliest rival in the place of each, where there is one.

    Args:
        dataset: rows.
        found: the selected laws.
    """
    gone = set[Key]()  # what was taken out does not come back
    for _ in range(ROUNDS):
        contenders = rank_contenders(dataset, found)
        if time_is_up(SEARCH):
            return found, contenders
        weak = [one for one in contenders if one.probability + one.unknown < DOUBT or one.instead is not None]
        if not weak:
            return found, contenders
        worst = min(weak, key=lambda contender: contender.probability)
        rest, rival = found.without(worst.group), worst.instead
        log = found.log_odds[worst.group]
        gone.add(worst.group.claim.key)
        possible = rival is not None and rival.claim.key not in gone and is_sound(rest, rival)
        better = [rival] if rival is not None and possible else []
        if not better and worst.probability + worst.unknown > DOUBT:
            return found, contenders
        found = found.with_selected((*rest.selected, *better), {**found.log_odds, **dict.fromkeys(better, log)})
    return found, rank_contenders(dataset, found)


def _contender(
    found: Selection, group: Group, rows: Sequence[_Rows], sizes: Sizes, likelihood: Likelihood
) -> Contender:
    odds, logs = _instead(found, group, rows[0])
    own = group.claim.key
    rest = found.without(group)
    certain = time_is_up(SEARCH) or relieved(found, rest, group)  # no discrepancy makes a heavy link possible
    penalty = 0.0 if certain else likelihood.penalty(group)
    log = (odds[own].log if own in odds else found.log_odds[group]) + penalty
    left = _leftovers(found.posterior, group, odds, sizes)
    for key in (key for key, o in odds.items() if o.best.claim.unknown):
        logs[key] -= INEXACT**2 / 2 * left[own]
    same = {key for key, x in left.items() if key != own and x <= max(HALF * left[own], SAME)}
    log_at_scale = _instead(found, group, rows[1])[1] if len(rows) > 1 else {}
    if own in logs and own in log_at_scale:
        logs |= {key: logs[own] + log_at_scale[key] - log_at_scale[own] for key in same & log_at_scale.keys()}
    logs = _possible(rest, odds, logs, own)
    highest = max(logs.values())
    weight = {key: float(np.exp(x - highest)) for key, x in logs.items()}
    total = sum(weight.values())
    share = {key: x / total for key, x in weight.items()}
    some = 1 / (1 + float(np.exp(-np.clip(log, -CLIP, CLIP))))
    listed = [key for key in same & share.keys() if some * share[key] > NOTABLE or left[key] < SAME]
    candidates = {key: odds[key].best for key in share if key in listed}
    unknown = sum(x for key, x in share.items() if odds[key].best.claim.unknown)
    others = {key: some * x for key, x in share.items() if key != own and not odds[key].best.claim.unknown}
    first = max(others, key=lambda key: others[key], default=own)
    likelier = others.get(first, 0.0) > max(LIKELIER * some * share.get(own, 0.0), DOUBT)
    return Contender(
        group=group,
        evidence=log,
        shares=share,
        candidates=dict(sorted(candidates.items(), key=lambda item: -share[item[0]])),
        unexplained=unknown,
        instead=odds[first].best if likelier else None,
        log_at_scale=log_at_scale.get(own, np.inf),
    )


def _instead(found: Selection, group: Group, rows: _Rows) -> tuple[dict[Key, Odds], dict[Key, float]]:
    """Everything in the place of a hypothesis, and its log odds there, less what it would gain beside it."""
    odds, _ = found.posterior.odds(found.selected, rows.dispersion, without=group)
    own, beside = group.claim.key, rows.beside
    odds = {key: o for key, o in odds.items() if key == own or len(o.best.claim.laws) <= 1}
    return odds, {key: o.log - max(0.0, beside[key].log if key in beside else 0.0) for key, o in odds.items()}


def _possible(rest: Selection, odds: Mapping[Key, Odds], logs: Mapping[Key, float], own: Key) -> dict[Key, float]:
    """The log odds without rivals that change what is not there, or near the likeliest and not physically possible."""
    there = laws_there(rest)
    some = {key for key in logs if key == own or odds[key].best.claim.unknown or is_founded(odds[key].best, there)}
    logs = {key: x for key, x in logs.items() if key in some}
    least = max(logs.values()) - NEAR
    near = [key for key, x in logs.items() if x > least and key != own and not odds[key].best.claim.unknown]
    impossible = [key for key in near if not is_sound(rest, odds[key].best)]
    return {key: x for key, x in logs.items() if key not in impossible}


def _is_twin(posterior: Posterior, group: Group, rival: Group) -> bool:
    """Whether another law at the same place is hard to tell from a hypothesis, as its effect says, at any size."""
    name, joints = rival.claim.key
    if joints != group.claim.key[1] or name not in group.claim.laws[0].effect.twins:
        return False
    prior = posterior.evidence.coefficient_priors[rival]
    return prior is not None and not prior.mean


def _leftovers(posterior: Posterior, group: Group, odds: Mapping[Key, Odds], sizes: Sizes) -> dict[Key, float]:
    """What rivals of some weight leave of a torque, sum of squares [variance of noise]; its own key: all of it."""
    data, own = posterior.evidence.data, group.claim.key
    joints = set(data.rows(group))
    torque = {j: data.part(j, group) @ sizes.value[group] for j in range(data.joints)}
    energy = {j: float(x @ x) for j, x in torque.items()}
    least = odds[own].log - FAR if own in odds else -np.inf
    out = {own: max(sum(energy.values()), 1e-300)}
    for key, rival in odds.items():
        twin, there = _is_twin(posterior, group, rival.best), data.rows(rival.best)
        if rival.best.claim.unknown or (rival.log < least and not twin) or joints.isdisjoint(there):
            continue
        elsewhere = sum(x for j, x in energy.items() if j not in there)
        if key != own and (twin or elsewhere < SAME):
            out[key] = elsewhere + _left(posterior, rival.best, torque)
    return out


def _left(posterior: Posterior, rival: Group, torque: Mapping[int, Array]) -> float:
    """Sum of squares that a rival and the refitted laws leave of some torque, on the rival's joints."""
    data, prior = posterior.evidence.data, posterior.evidence.coefficient_priors[rival]
    joints = data.rows(rival)
    own = np.concatenate([data.part(j, rival) for j in joints])
    target = np.concatenate([torque[j] for j in joints])
    if prior is not None and prior.mean:  # it is there or not
        target, own = target - own.sum(axis=1), own[:, :0]
    wide = [group for group in data.refitted if not group.bodies and len(data.rows(group)) > 1]
    columns = np.concatenate([own, *(np.concatenate([data.part(j, group) for j in joints]) for group in wide)], axis=1)
    parts = zip(joints, np.split(np.column_stack([target, columns]), len(joints)), strict=True)
    free = np.concatenate([data.free(j, part) for j, part in parts])
    told = np.linalg.norm(free[:, 1:], axis=0) > RANK * np.linalg.norm(columns, axis=0)
    return float(np.sum(leave(free[:, 0], free[:, 1:][:, told]) ** 2))
