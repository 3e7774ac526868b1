"""Findings that a number of a stated law, or a stated body, is wrong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ...effects import EFFECTS
from ...effects.base import TorqueLaw
from ...estimation.fit_quality import rms_of
from ...model import Model
from ...regression.projection import leave
from ...regression.session import Session
from ...types import Array, Law
from ..data.column_groups import Group
from ..data.dataset import Dataset
from ..data.hypotheses import VARIABLE_NAMES, Key
from ..data.locate import locate
from ..data.thresholds import MIN_LAW_TORQUE_SHARE
from ..evidence.bayes_factors import Evidence
from ..evidence.selection import Posterior, Selection
from ..extend.extend import extended_laws, is_plain, is_same
from ..extend.holdout import predict
from ..result import Alternative, Finding
from .held_out_selection import ExtendedSimulation
from .thresholds import CAUSE_PROBABILITY, LISTED_PROBABILITY, MIN_JOINT_SHARE, RIVAL_RESIDUAL_SHARE, USUAL_BODY_SHARE

INFORMATION_RANK = 1e-12  # eigenvalues of the scaled prior information, over the largest, that count as zero [1]
MAX_PROBABILITY, MAX_LOG_ODDS = 1 - 1e-9, 50.0  # bounds of probabilities and log odds, so that both stay finite [1]


def stated_number_findings(
    dataset: Dataset, session: Session, selection: Selection, extended: ExtendedSimulation
) -> Iterator[Finding]:
    """Causes that are wrong numbers of stated laws, for a diagnosis without other causes.

    Either a law of the library is behind the residual, or only stated numbers are; in the second case, each refitted
    number is wrong or exactly as stated.
    """
    no_law, library = _library_probabilities(selection)
    wrong = {g: no_law * p for g, p in _wrong_probabilities(selection, extended).items()}
    own = {g: library.get(_key(g, library), (0.0, g))[0] for g in wrong}
    likely = {g: min(p + own[g], MAX_PROBABILITY) for g, p in wrong.items()}
    likely = {g: p for g, p in likely.items() if p >= CAUSE_PROBABILITY}
    if not likely:
        return
    given, after = predict(session, dataset.model).held_out.residual, extended.prediction.held_out.residual
    fit, data = selection.reported(), selection.data
    for group, probability in sorted(likely.items(), key=lambda item: -item[1]):
        assert group.law is not None, "refitted laws are stated"
        place, joint = fit.place(group), group.law.joints[0]
        whole = total_law(group.law, dataset.model, extended.prediction.model)
        torque = data.raw(joint, group) @ fit.value[place]
        std = float(np.sqrt(fit.covariance[place, place][0, 0]))
        yield Finding(
            law=whole,
            std=dict.fromkeys(whole.effect.linear(), std),
            role="cause",
            probability=probability,
            torque_share=_share_of_step(selection.evidence, group, float(fit.value[place][0])),
            where=locate(dataset.table, joint, torque, bool(dataset.model.robot.prismatic[joint]), VARIABLE_NAMES[:-1]),
            statistic=float(np.log(probability / (1 - probability))),
            threshold=float(np.log(CAUSE_PROBABILITY / (1 - CAUSE_PROBABILITY))),
            held_out_gain=1 - float(np.nanmean(after[:, joint] ** 2) / np.nanmean(given[:, joint] ** 2)),
            alternatives=tuple(_rivals(selection.posterior, group, fit.value[place], library)),
            stated=stated_numbers(dataset.model, whole),
        )


def body_finding(
    dataset: Dataset, session: Session, selection: Selection, extended: ExtendedSimulation
) -> Iterator[Finding]:
    """Cause that bodies are wrong, where held-out rows support their refit, for a diagnosis without other causes.

    It names the body whose change makes most of the torque; the others share the probability as its alternatives.
    """
    evidence, data, model = selection.evidence, selection.data, extended.prediction.model
    groups = [group for group in data.refitted if group.bodies and group in extended.refitted]
    if not groups or evidence.informed:
        return
    step, energy = model.inertials - dataset.model.inertials, dict[int, float]()
    for joint, body in enumerate(selection.posterior.carried):
        parts = [data.part(j, groups[body]) @ step[body] for j in data.rows(groups[body])]
        energy[joint] = sum(float(x @ x) for x in parts)
    before = predict(session, dataset.model)
    strong = np.maximum(rms_of(before.train.torque), MIN_JOINT_SHARE * data.scale.max())
    usual = 1.0 if np.all(rms_of(before.train.residual) < USUAL_BODY_SHARE * strong) else 0.0  # scale of no mismatch
    wrong = float(np.sum(evidence.log_bayes_factors((), selection.dispersion)[1][evidence.scales > usual]))
    shares = {j: wrong * x / max(sum(energy.values()), 1e-300) for j, x in energy.items()}
    first, last = max(shares, key=lambda j: shares[j]), len(shares) - 1
    effect, body = EFFECTS["link_inertia"], selection.posterior.carried[first]
    rivals = [(x, Law(effect, (j,))) for j, x in shares.items() if j != first]
    if first == last:  # a payload is a change of the last body
        shares[first] /= 2
        rivals.append((shares[first], Law(EFFECTS["payload"], (last,))))
    law = Law(effect, (first,), dict(zip(effect.parameters, step[body].tolist(), strict=True)))
    torque = {j: data.raw(j, groups[body]) @ step[body] for j in data.rows(groups[body])}
    share = torque_share(torque, data.scale)
    if min(share.max() / MIN_LAW_TORQUE_SHARE, wrong / CAUSE_PROBABILITY) < 1:
        return
    joint, fit = int(np.argmax(share)), selection.reported()
    std = np.sqrt(np.diag(fit.covariance)[fit.place(groups[body])])
    given, after = before.held_out.residual, extended.prediction.held_out.residual
    yield Finding(
        law=law,
        std=dict(zip(effect.parameters, std.tolist(), strict=True)),
        role="cause",
        probability=min(shares[first], MAX_PROBABILITY),
        torque_share=share,
        where=locate(dataset.table, joint, torque[joint], bool(model.robot.prismatic[joint]), VARIABLE_NAMES[:-1]),
        statistic=float(np.log(max(wrong, 1e-300) / max(1 - wrong, np.exp(-MAX_LOG_ODDS)))),
        threshold=float(np.log(CAUSE_PROBABILITY / (1 - CAUSE_PROBABILITY))),
        held_out_gain=1 - float(np.nanmean(after[:, joint] ** 2) / np.nanmean(given[:, joint] ** 2)),
        alternatives=tuple(
            Alternative(rival, x, "")
            for x, rival in sorted(rivals, key=lambda pair: -pair[0])
            if x > LISTED_PROBABILITY
        ),
    )


def total_law(law: Law, given: Model, extended: Model | None) -> Law:
    """Sum of a law and of what the simulation states of it, or of simpler laws that it contains.

    `extended` is None where the extended simulation does not contain the law.
    """
    model = extended or Model(given.robot, given.inertials, extended_laws(given.laws, [law]))
    return next((other for other in model.laws if is_same(law, other)), law)


def reported_laws(given: Model, extended: ExtendedSimulation) -> dict[Group, tuple[Law, ...]]:
    """Laws of each hypothesis, at the numbers that findings report where the torque is not linear in these.

    The standard deviation of a phase, for example, is that beside the whole amplitude, not beside its change.
    """
    return {
        group: tuple(
            _reported(law, given, extended.prediction.model if group in extended.kept else None) for law in own
        )
        for group, own in extended.laws.items()
    }


def _reported(law: Law, given: Model, extended: Model | None) -> Law:
    known = isinstance(law.effect, TorqueLaw) and any(is_same(law, other) for other in given.laws)
    return total_law(law, given, extended) if known and not is_plain(law.effect) else law


def stated_numbers(model: Model, law: Law) -> dict[str, float]:
    """Numbers that the simulation states of a law with the same joints and shape."""
    same = next((other for other in model.laws if is_same(law, other)), None)  # the one that `total_law` adds to
    numbers = {} if same is None else same.parameters
    return {key: float(x) for key, x in numbers.items() if key in law.effect.linear()}


def torque_share(torque: Mapping[int, Array], scale: Array) -> Array:
    """(n,) rms of torque: (M,) [N.m or N] of some joints over the rms of all, scale: (n,) [N.m or N]."""
    out = np.zeros(len(scale))
    for j, x in torque.items():
        out[j] = np.sqrt(np.mean(x**2)) / scale[j]
    return out


def _library_probabilities(selection: Selection) -> tuple[float, dict[Key, tuple[float, Group]]]:
    """Probability that no law of the library is behind the residual, and that of each law."""
    odds = selection.posterior.odds(selection.selected, selection.dispersion)[0]
    each = {key: float(np.exp(np.clip(one.log, -MAX_LOG_ODDS, MAX_LOG_ODDS))) for key, one in odds.items()}
    total = 1 + sum(each.values())
    return 1 / total, {key: (x / total, odds[key].best) for key, x in each.items()}


def _wrong_probabilities(selection: Selection, extended: ExtendedSimulation) -> dict[Group, float]:
    """Probability that the number of each refitted law of one number is wrong, if only stated numbers are.

    Source: Dickey, Ann. Math. Statist. 42, 1971 (Savage's density ratio).
    """
    groups = [g for g in extended.refitted if g.law is not None and g.size == 1]
    fit, before = selection.fit(), _prior_variance(selection.evidence, selection.prior_scale)
    covariance, out = fit.covariance, dict[Group, float]()
    for group in sorted(groups, key=lambda one: one.start):
        at = fit.place(group).start
        value, variance, prior = float(fit.value[at]), float(covariance[at, at]), before.get(group, np.inf)
        large = _share_of_step(selection.evidence, group, value).max() >= MIN_LAW_TORQUE_SHARE
        if 0 < variance < prior < np.inf and large:
            log = np.clip((np.log(variance / prior) + value**2 / variance) / 2, -MAX_LOG_ODDS, MAX_LOG_ODDS)
            out[group] = float(1 / (1 + np.exp(-log)))
    return out


def _key(group: Group, library: Mapping[Key, tuple[float, Group]]) -> Key:
    """Key of the hypothesis that the size of a stated law is wrong; without one, effect and joints."""
    law = group.law
    assert law is not None, "refitted laws are stated"
    found = (key for key, (_, best) in library.items() if best.claim.stated is not None and best.claim.stated is law)
    return next(found, (law.effect.name, law.joints))


def _rivals(
    posterior: Posterior, group: Group, value: Array, library: Mapping[Key, tuple[float, Group]]
) -> Iterator[Alternative]:
    """Laws of the library that make at least half of the torque of a changed number, the most probable first."""
    data, own = posterior.evidence.data, _key(group, library)
    joint = own[1][0]
    torque = data.part(joint, group) @ value
    for key, (probability, rival) in sorted(library.items(), key=lambda item: -item[1][0]):
        if probability > LISTED_PROBABILITY and key != own and rival.claim.laws and joint in data.rows(rival):
            rest = leave(torque, data.part(joint, rival))
            if rest @ rest <= RIVAL_RESIDUAL_SHARE * (torque @ torque):
                yield Alternative(rival.claim.laws[0], probability, "")


def _prior_variance(evidence: Evidence, prior_scale: float) -> dict[Group, float]:
    """Prior variance of each stated law of one number [its unit, squared]."""
    laws = [g for g in evidence.data.refitted if g.law is not None and g.size == 1]
    if evidence.stated_prior is None:
        return {g: g.deviation[0] ** 2 for g in laws}
    columns, information = evidence.stated_prior
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information / size / size[:, None], rcond=INFORMATION_RANK, hermitian=True)
    variance = prior_scale**2 * np.diag(inverse / size / size[:, None])
    by_column = dict(zip(columns.tolist(), variance.tolist(), strict=True))
    return {g: by_column.get(g.start, np.inf) for g in laws}


def _share_of_step(evidence: Evidence, group: Group, value: float) -> Array:
    """(n,) rms torque of a change of a number, over that of each joint [1]."""
    data = evidence.data
    return torque_share({j: data.raw(j, group) * value for j in data.rows(group)}, data.scale)
