"""The smallest law of each effect and joint that the recordings would have named: the power of a diagnosis.

Where the truth has coefficients s d of a law beyond the selected ones, z of its log Bayes factor has the mean A d s and
the covariance A (`evidence/bayes_factors`), and the log evidence of the selected ones alone grows by half of
s^2 d'(S'S - A)d. So the log posterior odds follow for each size s without another search, at each prior scale of the
simulation's errors. A law is named where they reach the threshold of the search although the noise makes it appear
smaller by 1.28 standard deviations, as it does in one case of ten.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp, ndtri

from ..effects.base import RecordingLaw
from ..effects.naming import law_place
from ..types import Array, Law, Robot
from .data.hypotheses import Key
from .data.rows import Group
from .evidence.bayes_factors import StackedPriors, log_bayes_factor
from .evidence.selection import Selection
from .result import Detectable
from .search.stepwise import inflated_dispersion, is_applicable, present_laws, required_log_odds
from .thresholds import FIRST_LOG_ODDS, MIN_LAW_TORQUE_SHARE, NEXT_LOG_ODDS, PRIOR_NOTHING, RECORDING_LIMITS

NAMING_PROBABILITY = 0.9  # probability with which a law of the smallest size is named [1]
SHORTFALL_DEVIATIONS = float(ndtri(NAMING_PROBABILITY))  # standard deviations by which it then appears smaller [1]
MIN_INFORMATION = 1e-30  # [1 per coefficient, squared] lower bound, so that its inverse exists
TRIED_SIZES = np.geomspace(1.0, 1e4, 50)[:, None]  # (sizes, 1) that are tried [standard deviations of the coefficient]

_ParameterKey = tuple[str, str | None, str]  # effect, joint and parameter


class Power(NamedTuple):
    """Log Bayes factors of g laws at increasing sizes, averaged over the prior scales."""

    sizes: Array  # (sizes, g) [unit of the main coefficient]
    log: Array  # (sizes, g) [-]
    trusted: Array  # (sizes, g) [1] probability of the first prior scale
    std: Array  # (g,) [unit of the main coefficient] standard deviation of its estimate


def detectable(selection: Selection, robot: Robot) -> tuple[Detectable, ...]:
    """Smallest size of every law with coefficients that is not selected; of a law with shapes, the median over them."""
    dispersion, found = inflated_dispersion(selection), dict[Key, list[tuple[Law, float]]]()
    evidence, selected, present = selection.evidence, selection.selected, present_laws(selection)
    squares = [evidence.complements(selected, dispersion, scale) for scale in evidence.scales]
    logs = evidence.scale_prior + [evidence.fit(selected, dispersion, k).log_evidence for k in evidence.scales]
    taken = {key for group in selected for key in group.claim.names}
    for batch, *own in zip(evidence.batches, *squares, strict=True):
        every = [evidence.data.groups[g] for g in batch.groups]
        usable = [
            is_applicable(g, present)
            and g.claim.key not in taken
            and not (g.claim.finite or g.claim.scaled)  # its columns are derivatives
            and bool(g.claim.laws[0].effect.linear())
            for g in every
        ]
        which = np.flatnonzero(usable)
        if not len(which):
            continue
        groups = [every[g] for g in which]
        direction = np.array([_direction(group.claim.laws[0]) for group in groups])
        whole = np.tensordot(1 / dispersion, batch.blocks[:, which], axes=1)
        power = measure_power(batch.priors.take(which), np.array(own)[:, which], whole, direction, logs)
        for g, group in enumerate(groups):
            size = _smallest(selection, group, direction[g], Power(*(x[..., g] for x in power)))
            found.setdefault(group.claim.key, []).append((group.claim.laws[0], size))
    return tuple(_listed({key: found[key] for key in selection.posterior.keys if key in found}, robot))


def measure_power(priors: StackedPriors, own: Array, whole: Array, direction: Array, logs: Array) -> Power:
    """Log Bayes factors of laws of growing size, at the shortfall by noise.

    At size 1 they are direction (g, d) [1 per main coefficient]; own (k, g, d, d) [1 per coefficient, squared]
    is A at each prior scale; whole (g, d, d) [1 per coefficient, squared] is S'S; logs (k,) [-] of scales.
    """
    along, most = (np.einsum("gi,...gij,gj->...g", direction, x, direction) for x in (own, whole))
    std = np.maximum(along, np.maximum(1e-12 * most, MIN_INFORMATION)) ** -0.5  # (k, g)
    sizes = TRIED_SIZES * std.min(axis=0)
    seen = np.maximum(sizes - SHORTFALL_DEVIATIONS * std[:, None], 0.0)  # (k, sizes, g)
    beside = logs[:, None, None] + sizes**2 * (most - along)[:, None] / 2
    right = np.einsum("kgij,gj,ktg->ktgi", own, direction, seen)
    factors = np.array([log_bayes_factor(priors, a, z) for a, z in zip(own, right, strict=True)])
    scale = logsumexp(beside, axis=0)
    return Power(sizes, logsumexp(beside + factors, axis=0) - scale, np.exp(beside[0] - scale), std.min(axis=0))


def _direction(law: Law) -> Array:
    """(d,) coefficients of a law whose main parameter is 1 and whose other coefficients are 0."""
    effect = law.effect
    one = {**dict.fromkeys(effect.linear(), 0.0), **effect.shape(law.parameters), next(iter(effect.linear())): 1.0}
    return np.array(effect.coefficients(one))


def _smallest(selection: Selection, group: Group, direction: Array, power: Power) -> float:
    """Smallest size of a law that is named and plausible [unit of its main coefficient]; infinite if there is none."""
    data, posterior, law = selection.data, selection.posterior, group.claim.laws[0]
    rms = [np.sqrt(np.mean((data.raw(j, group) @ direction) ** 2)) / data.scale[j] for j in data.rows(group)]
    share, key, count = float(max(rms, default=0.0)), group.claim.key, len(selection.selected)
    odds = power.log + posterior.priors[key] - np.log(len(posterior.keys[key]) * PRIOR_NOTHING)
    at, needed = -1, NEXT_LOG_ODDS if count else FIRST_LOG_ODDS
    for trusted in (1.0, 0.0):  # more is needed where the law makes the stated inertials improbable
        if power.trusted[at] < 0.5 or trusted:
            needed = required_log_odds(posterior, group, trusted, count, needed)
            at = int(np.argmax(odds >= needed))
    if odds[at] < needed or share == 0:
        return np.inf
    rise = float(np.interp(needed, odds[at - 1 : at + 1], [0.0, 1.0])) if at else 1.0
    size = power.sizes[at - 1] ** (1 - rise) * power.sizes[at] ** rise
    size = max(float(size), MIN_LAW_TORQUE_SHARE / share + SHORTFALL_DEVIATIONS * float(power.std))
    unit = next(iter(law.effect.linear().values())).unit
    most = RECORDING_LIMITS.get(unit, np.inf) if isinstance(law.effect, RecordingLaw) else np.inf
    return size if size <= most and size * share <= 1 else np.inf


def _listed(found: Mapping[Key, Sequence[tuple[Law, float]]], robot: Robot) -> Iterator[Detectable]:
    """One size for each effect and joint: the median over shapes, the largest over partners."""
    sizes, units = dict[_ParameterKey, float](), dict[_ParameterKey, str]()
    for some in found.values():
        law, (parameter, kind) = some[0][0], next(iter(some[0][0].effect.linear().items()))
        joint = law_place(law, robot)[0]
        place = law.effect.name, joint, parameter
        sizes[place] = max(sizes.get(place, 0.0), float(np.median([size for _, size in some])))
        units[place] = kind.unit_at(len(law.joints) == 1 and bool(robot.prismatic[law.joints[0]]))
    for place, size in sizes.items():
        yield Detectable(*place, size if np.isfinite(size) else None, units[place])
