"""Laws that the simulation states -> those whose numbers are of another size, as held-out rows say."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..model import Model
from ..session import Session
from ..types import Array, Law
from .evidence import Evidence
from .extend import extended_laws
from .found import Found
from .group import Group
from .handout import Extended
from .hypothesis import VARIABLES
from .locate import locate
from .odds import Judge
from .prove import show
from .result import Finding
from .setting import Setting
from .slots import DOUBT

LOST = 1e-12  # of the largest eigenvalue of the prior information, scaled: nothing is known in such directions
LEAST = 0.007  # share of the joint's torque that the change of a number makes
SURE = 1 - 1e-9  # most probable


def resized(setting: Setting, session: Session, judge: Judge, found: Found, extended: Extended) -> Iterator[Finding]:
    """Laws that the simulation states, whose numbers held-out rows want otherwise: causes where nothing else is one.

    Args:
        setting: motions and rows.
        session: gives what is held out.
        judge: library and evidence.
        found: what is taken for true.
        extended: what was handed out.
    """
    likely = {group: p for group, p in _wrong_sizes(judge, found, extended).items() if p >= DOUBT}
    if not likely:
        return
    given, after = show(session, setting.model).judged.rest, extended.shown.judged.rest
    fit, data = judge.evidence.fit(found.true, found.base, found.trust), judge.evidence.data
    for group, probability in sorted(likely.items(), key=lambda item: -item[1]):
        assert group.law is not None, "what was refitted is stated"
        place, joint = fit.place(group), group.law.joints[0]
        whole = whole_law(group.law, setting.model, extended.shown.model)
        torque, share = data.raw(joint, group) @ fit.value[place], np.zeros(setting.table.joints)
        share[joint] = np.sqrt(np.mean(torque**2)) / data.scale[joint]
        std = float(np.sqrt(fit.covariance[place, place][0, 0]))
        yield Finding(
            law=whole,
            std=dict.fromkeys(whole.effect.linear(), std),
            role="cause",
            probability=probability,
            torque_share=share,
            where=locate(setting.table, joint, torque, bool(setting.model.robot.prismatic[joint]), VARIABLES[:-1]),
            statistic=float(np.log(probability / (1 - probability))),
            threshold=float(np.log(DOUBT / (1 - DOUBT))),
            held_out_gain=1 - float(np.nanmean(after[:, joint] ** 2) / np.nanmean(given[:, joint] ** 2)),
            alternatives=(),
            stated=stated_numbers(setting.model, whole),
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


def _wrong_sizes(judge: Judge, found: Found, extended: Extended) -> dict[Group, float]:
    """Laws of one number that were refitted, and the probability that what the simulation states of each is wrong.

    Either a law of the library is behind what differs, or only numbers that the simulation states; then a number is off
    or not, by the ratio of its prior and posterior density where it is exactly as stated.

    Source: Dickey, Ann. Math. Statist. 42, 1971 (Savage's density ratio).
    """
    evidence, groups = judge.evidence, [g for g in extended.refitted if g.law is not None and g.size == 1]
    if not groups:
        return {}
    odds = judge.odds(found.true, found.base)[0]
    logs = {key: float(np.clip(one.log, -50.0, 50.0)) for key, one in odds.items()}
    total = 1 + sum(np.exp(x) for x in logs.values())
    fit, before = evidence.fit(found.true, found.base, found.trust), _stated_variance(evidence, found.trust)
    covariance, out = fit.covariance, dict[Group, float]()
    for group in sorted(groups, key=lambda one: one.start):
        at, law = fit.place(group).start, group.law
        assert law is not None
        value, variance, prior = float(fit.value[at]), float(covariance[at, at]), before.get(group, np.inf)
        if not 0 < variance < prior < np.inf or _share(evidence, group, value) < LEAST:
            continue
        log = np.clip((np.log(variance / prior) + value**2 / variance) / 2, -50.0, 50.0)
        same = np.exp(logs.get((law.effect.name, law.joints), -np.inf))
        out[group] = min(float((1 / (1 + np.exp(-log)) + same) / total), SURE)
    return out


def _stated_variance(evidence: Evidence, trust: float) -> dict[Group, float]:
    """Prior variance of each law of one number [its unit, squared]."""
    laws = [g for g in evidence.data.refitted if g.law is not None and g.size == 1]
    if evidence.known is None:
        return {g: g.deviation[0] ** 2 for g in laws}
    columns, information = evidence.known
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information / size / size[:, None], rcond=LOST, hermitian=True) / size / size[:, None]
    variance = dict(zip(columns.tolist(), (trust**2 * np.diag(inverse)).tolist(), strict=True))
    return {g: variance.get(g.start, np.inf) for g in laws}


def _share(evidence: Evidence, group: Group, value: float) -> float:
    """Largest rms torque that a change of a number makes, over that of the joint [1]."""
    data = evidence.data
    torque: dict[int, Array] = {j: data.raw(j, group)[:, 0] * value for j in data.rows(group)}
    return max((float(np.sqrt(np.mean(x**2)) / data.scale[j]) for j, x in torque.items()), default=0.0)
