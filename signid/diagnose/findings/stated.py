"""Laws that the simulation states -> those whose numbers are of another size, as held-out rows say."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ...model import Model
from ...regression.projection import leave
from ...regression.session import Session
from ...types import Array, Law
from ..data.column_groups import Group
from ..data.dataset import Dataset
from ..data.hypotheses import VARIABLES, Key
from ..data.locate import locate
from ..evidence.bayes_factors import Evidence
from ..evidence.posterior_odds import Posterior
from ..evidence.selection import Selection
from ..extend.extend import extended_laws
from ..extend.holdout import show
from ..result import Alternative, Finding
from ..search.feasible import LEAST
from .alternatives import DOUBT, HALF, NOTABLE
from .held_out_selection import Extended

LOST = 1e-12  # of the largest eigenvalue of the prior information, scaled: nothing is known in such directions
SURE, MOST = 1 - 1e-9, 50.0  # most probable; largest log odds


def resized(dataset: Dataset, session: Session, found: Selection, extended: Extended) -> Iterator[Finding]:
    """Laws that the simulation states, whose numbers held-out rows want otherwise: causes where nothing else is one.

    Either a law of the library is behind what differs, or only numbers that the simulation states; then a number is off
    or exactly as stated.

    Args:
        dataset: motions and rows.
        session: gives what is held out.
        found: the selected laws.
        extended: what was handed out.
    """
    none, others = _behind(found)
    off = {g: none * p for g, p in _off(found.evidence, found, extended).items()}
    likely = {g: min(p + (others[_name(g)][0] if _name(g) in others else 0.0), SURE) for g, p in off.items()}
    likely = {g: p for g, p in likely.items() if p >= DOUBT}
    if not likely:
        return
    given, after = show(session, dataset.model).judged.rest, extended.shown.judged.rest
    fit, data = found.fit(), found.data
    for group, probability in sorted(likely.items(), key=lambda item: -item[1]):
        assert group.law is not None, "what was refitted is stated"
        place, joint = fit.place(group), group.law.joints[0]
        whole = whole_law(group.law, dataset.model, extended.shown.model)
        torque = data.raw(joint, group) @ fit.value[place]
        std = float(np.sqrt(fit.covariance[place, place][0, 0]))
        yield Finding(
            law=whole,
            std=dict.fromkeys(whole.effect.linear(), std),
            role="cause",
            probability=probability,
            torque_share=_share(found.evidence, group, float(fit.value[place][0])),
            where=locate(dataset.table, joint, torque, bool(dataset.model.robot.prismatic[joint]), VARIABLES[:-1]),
            statistic=float(np.log(probability / (1 - probability))),
            threshold=float(np.log(DOUBT / (1 - DOUBT))),
            held_out_gain=1 - float(np.nanmean(after[:, joint] ** 2) / np.nanmean(given[:, joint] ** 2)),
            alternatives=tuple(_rivals(found.posterior, group, fit.value[place], others)),
            stated=stated_numbers(dataset.model, whole),
        )


def whole_law(law: Law, given: Model, extended: Model | None) -> Law:
    """The law with all that the simulation states of it, or of plainer ones that it contains.

    Args:
        law: as it was found, a change of what the simulation states.
        given: the simulation.
        extended: the extended one, None where it does not have the law.
    """
    model = extended or Model(given.robot, given.inertials, extended_laws(given.laws, [law]))
    same = [other for other in model.laws if (other.effect.name, other.joints) == (law.effect.name, law.joints)]
    shape = law.effect.shape(law.parameters)
    return next((other for other in same if other.effect.shape(other.parameters) == shape), law)


def stated_numbers(model: Model, whole: Law) -> dict[str, float]:
    """What the simulation states of a law."""
    effect, out = whole.effect, dict[str, float]()
    for law in (law for law in model.laws if law.joints == whole.joints):
        if law.effect is effect and effect.shape(law.parameters) == effect.shape(whole.parameters):
            out |= {key: float(x) for key, x in law.parameters.items() if key in effect.linear()}
    return out


def _behind(found: Selection) -> tuple[float, dict[Key, tuple[float, Group]]]:
    """The probability that no law of the library is behind what differs, and that of each."""
    odds = found.posterior.odds(found.selected, found.dispersion)[0]
    each = {key: float(np.exp(np.clip(one.log, -MOST, MOST))) for key, one in odds.items()}
    total = 1 + sum(each.values())
    return 1 / total, {key: (x / total, odds[key].best) for key, x in each.items()}


def _off(evidence: Evidence, found: Selection, extended: Extended) -> dict[Group, float]:
    """Laws of one number that were refitted, and the probability that it is off, if stated numbers alone are.

    Source: Dickey, Ann. Math. Statist. 42, 1971 (Savage's density ratio).
    """
    groups = [g for g in extended.refitted if g.law is not None and g.size == 1]
    fit, before = (
        evidence.fit(found.selected, found.dispersion, found.prior_scale),
        _stated_variance(evidence, found.prior_scale),
    )
    covariance, out = fit.covariance, dict[Group, float]()
    for group in sorted(groups, key=lambda one: one.start):
        at = fit.place(group).start
        value, variance, prior = float(fit.value[at]), float(covariance[at, at]), before.get(group, np.inf)
        if 0 < variance < prior < np.inf and _share(evidence, group, value).max() >= LEAST:
            log = np.clip((np.log(variance / prior) + value**2 / variance) / 2, -MOST, MOST)
            out[group] = float(1 / (1 + np.exp(-log)))
    return out


def _name(group: Group) -> Key:
    assert group.law is not None, "what was refitted is stated"
    return group.law.effect.name, group.law.joints


def _rivals(
    posterior: Posterior, group: Group, value: Array, likely: Mapping[Key, tuple[float, Group]]
) -> Iterator[Alternative]:
    """Laws of the library that make at least half of the torque of a change, the likeliest first."""
    data, joint = posterior.evidence.data, _name(group)[1][0]
    torque = data.part(joint, group) @ value
    for key, (probability, rival) in sorted(likely.items(), key=lambda item: -item[1][0]):
        if probability > NOTABLE and key != _name(group) and rival.claim.laws and joint in data.rows(rival):
            rest = leave(torque, data.part(joint, rival))
            if rest @ rest <= HALF * (torque @ torque):
                yield Alternative(rival.claim.laws[0], probability, "")


def _stated_variance(evidence: Evidence, prior_scale: float) -> dict[Group, float]:
    """Prior variance of each law of one number [its unit, squared]."""
    laws = [g for g in evidence.data.refitted if g.law is not None and g.size == 1]
    if evidence.stated_prior is None:
        return {g: g.deviation[0] ** 2 for g in laws}
    columns, information = evidence.stated_prior
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information / size / size[:, None], rcond=LOST, hermitian=True) / size / size[:, None]
    variance = dict(zip(columns.tolist(), (prior_scale**2 * np.diag(inverse)).tolist(), strict=True))
    return {g: variance.get(g.start, np.inf) for g in laws}


def _share(evidence: Evidence, group: Group, value: float) -> Array:
    """(n,) rms torque that a change of a number makes, over that of each joint [1]."""
    data, out = evidence.data, np.zeros(evidence.data.joints)
    for j in data.rows(group):
        out[j] = np.sqrt(np.mean((data.raw(j, group) * value) ** 2)) / data.scale[j]
    return out
