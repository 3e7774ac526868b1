"""Findings that stated numbers or bodies are wrong, and the ordinary that a description does not state.

The ordinary is friction, rotor and offset of every joint. Where a description states no friction, or the same number
in every joint, these are one block of columns with flat priors beside every hypothesis, so that other laws are weighed
with its coefficients integrated out.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...deadline import seconds_left
from ...effects import EFFECTS
from ...effects.base import TorqueLaw
from ...effects.law import law_torque
from ...estimation.fit_quality import rms_of
from ...model import Model
from ...regression.projection import leave
from ...regression.session import Session
from ...types import TWO_SIDED, Array, Law
from .. import thresholds as tuned
from ..data.dataset import Dataset
from ..data.estimated_gains import EstimatedGain
from ..data.hypotheses import VARIABLE_NAMES, Key
from ..data.locate import locate
from ..data.motions import pieces
from ..data.rows import Group, rough_drives
from ..evidence.bayes_factors import Evidence
from ..evidence.selection import Posterior, Selection
from ..extend import extended_laws, is_plain, is_same
from ..holdout import Prediction, predict
from ..result import Alternative, Finding
from .held_out_selection import ExtendedSimulation, error_change

ORDINARY_EFFECTS = ("coulomb_friction", "viscous_friction", "torque_offset", "armature")
FORM_EFFECTS = ("link_inertia", "asymmetric_friction", "stribeck_friction", "quadratic_friction", "presliding_friction")
MIN_START = 1e-6  # least start of friction and rotors [their units]: zero numbers are no columns
ROUGH_LAWS = 2  # laws that begin at estimates, since other laws, such as a delay, change their torque
MIN_PLACEHOLDER_JOINTS = 3  # joints in which equal friction is a placeholder, at least
CLEAR_DEVIATIONS = 3.0  # from zero, from which an offset or a rotor is fitted beside laws [std]; heuristic
MAX_BODY_PROBABILITY = 0.9  # probability of one changed body where all may be wrong, at most [1]; heuristic
ORDINARY_SHARE = 0.2  # prior rms torque of an ordinary law over its joint's [1]; heuristic
INFORMATION_RANK = 1e-12  # eigenvalues of the scaled prior information, over the largest, that count as zero [1]
MAX_PROBABILITY, MAX_LOG_ODDS = 1 - 1e-9, 50.0  # bounds of probabilities and log odds, so that both stay finite [1]


def with_ordinary(model: Model, session: Session, skip: Collection[str]) -> tuple[Model, tuple[Law, ...]]:
    """Description with the ordinary laws that it does not state, at rough numbers, and the laws of the block.

    Without change where friction is stated, where the model was identified, or where no time is left to fit them.
    """
    stated = [law for law in model.laws if law.effect.dissipative and any(law.effect.coefficients(law.parameters))]
    numbers = {(law.effect.name, *law.parameters.values()) for law in stated}
    everywhere = len({law.joints for law in stated}) == len(model.robot.joints) >= MIN_PLACEHOLDER_JOINTS
    assumed = stated if len(numbers) == 1 and everywhere else []  # the same in every joint is nobody's measurement
    identified = model.covariance is not None or model.misfit is not None
    if identified or len(assumed) < len(stated) or seconds_left() <= 0:
        return model, ()
    kept = [x for x in model.laws if x.effect.name not in ORDINARY_EFFECTS or any(x.effect.coefficients(x.parameters))]
    rough, laws = rough_drives(tuple(pieces(session.task, model, session.train))), list[Law]()
    for k, name in enumerate(ORDINARY_EFFECTS):
        effect, start = EFFECTS[name], np.maximum(rough[:, k] if k < ROUGH_LAWS else np.zeros(len(rough)), MIN_START)
        (key,) = effect.linear()
        known = {law.joints[0] for law in kept if law.effect is effect}
        bare = [j for j in range(len(rough)) if j not in known and name not in skip]
        laws += [Law(effect, (j,), {key: float(start[j])}) for j in bare]
    return replace(model, laws=(*kept, *laws)), (*assumed, *laws)


def block_of(selection: Selection, ordinary: Sequence[Law]) -> tuple[Group, ...]:
    """Groups of the block among the refitted columns."""
    return tuple(group for group in selection.data.refitted if group.law is not None and group.law in ordinary)


def without_vague(
    session: Session, extended: Prediction, ordinary: Sequence[Law], findings: Sequence[Finding]
) -> Prediction:
    """Extended simulation without the added laws of the block that are no findings, if it predicts as well."""
    named, laws = [finding.law for finding in findings], extended.model.laws
    vague = [x for x in laws if any(is_same(x, y) for y in ordinary) and not any(is_same(x, y) for y in named)]
    if not vague:
        return extended
    fewer = predict(session, replace(extended.model, laws=tuple(law for law in laws if law not in vague)))
    worse = error_change(fewer.held_out, extended.held_out) > tuned.EQUAL_PREDICTION_GAIN
    return extended if worse else fewer


def impossible(selection: Selection, ordinary: Sequence[Law]) -> list[Law]:
    """Rotors of the block whose inertia is clearly negative: in a motion of one frequency, such a rotor is a spring."""
    rotors = [(law, x) for law, x in _deviations(selection, ordinary) if law.effect.name == ORDINARY_EFFECTS[-1]]
    return [law for law, x in rotors if x < -CLEAR_DEVIATIONS]


def without(evidence: Evidence, laws: Sequence[Law]) -> Evidence:
    """Evidence in which some laws of the block are held at zero."""
    data = evidence.data
    groups = tuple(replace(g, deviation=(MIN_START,)) if g.law in laws else g for g in data.groups)
    return Evidence(replace(data, groups=groups), evidence.stated_prior, evidence.bare)


def pinned(selection: Selection, ordinary: Sequence[Law]) -> Selection:
    """Selection in which vague rotors and offsets are zero, so that numbers such as the rest of a spring are clear."""
    late = [(law, x) for law, x in _deviations(selection, ordinary) if law.effect.name in ORDINARY_EFFECTS[ROUGH_LAWS:]]
    evidence = without(selection.evidence, [law for law, x in late if not abs(x) > CLEAR_DEVIATIONS])
    posterior = replace(selection.posterior, evidence=evidence)
    return replace(selection, posterior=posterior).with_selected(selection.selected) if late else selection


def _deviations(selection: Selection, ordinary: Sequence[Law]) -> list[tuple[Law, float]]:
    """Laws of the block with their coefficients over their standard deviations [1]."""
    fit = selection.fit()
    std = np.sqrt(np.diag(fit.covariance))
    places = [(group.law, fit.place(group).start) for group in block_of(selection, ordinary)]
    return [(law, float(fit.value[at] / std[at])) for law, at in places if law is not None]


def ordinary_findings(
    given: Model, dataset: Dataset, selection: Selection, extended: Prediction, ordinary: Sequence[Law]
) -> Iterator[Finding]:
    """One cause for each ordinary law whose torque counts and is clearly not what the description states.

    Source: Dickey, Ann. Math. Statist. 42, 1971 (Savage's density ratio).
    """
    fit, data = selection.reported(), selection.data
    for group in block_of(selection, ordinary):
        assert group.law is not None, "the block has laws"
        (joint,), (key,) = group.law.joints, group.law.effect.linear()
        law = next((x for x in extended.model.laws if is_same(x, group.law)), None)
        if law is None:
            continue
        stated = stated_numbers(given, law)
        step = law.parameters[key] - stated.get(key, 0.0)
        column, place = data.raw(joint, group)[:, 0], fit.place(group)
        size = float(np.sqrt(np.mean(column**2))) / data.scale[joint]
        variance = float(fit.covariance[place, place][0, 0])
        shrunk = 1 / (1 + variance * (size / ORDINARY_SHARE) ** 2)  # variance of the posterior over that of the rows
        odds = (np.log(1 - shrunk + 1e-12) + shrunk * step**2 / variance) / 2
        odds = float(np.clip(odds, -MAX_LOG_ODDS, MAX_LOG_ODDS))
        share = torque_share({joint: column * step}, data.scale)
        inside = isinstance(group.law.effect, EstimatedGain) and abs(step) < TWO_SIDED * np.sqrt(variance)
        if odds < 0 or share[joint] < tuned.MIN_LAW_TORQUE_SHARE or inside:
            continue
        rows, change = extended.held_out, replace(law, parameters={key: step})
        removed = np.concatenate([rows.thin(law_torque(change, piece.motion)[1][:, :1]) for piece in rows.pieces])
        after = rows.residual[:, joint]
        before = after + removed[:, 0]
        yield Finding(
            law=law,
            std={key: float(np.sqrt(variance))},
            role="cause",
            probability=float(1 / (1 + np.exp(-odds))),
            torque_share=share,
            where=locate(dataset.table, joint, column * step, bool(given.robot.prismatic[joint]), VARIABLE_NAMES[:-1]),
            statistic=odds,
            threshold=0.0,
            held_out_gain=1 - float(np.nansum(after**2)) / max(float(np.nansum(before**2)), 1e-300),
            alternatives=(),
            stated=stated,
            ordinary=True,
        )


def beside_wrong_bodies(finding: Finding, joints: int, gains: Collection[int] = ()) -> Finding:
    """A change of a body, or a gain, with its structural twins as alternatives: other bodies may be wrong with it.

    `gains`: joints whose torque constants were estimated, so that rotors and gains make the same torque, too.
    """
    own, (first, last) = (finding.law.effect.name, finding.law.joints), (finding.law.joints[0], joints - 1)
    known = {own, *((x.law.effect.name, x.law.joints) for x in finding.alternatives)}
    near = [("link_inertia", (j,)) for j in (first - 1, first, first + 1) if 0 <= j <= last]
    drives = [(name, (j,)) for j in gains for name in ("armature", "torque_gain") if j <= first]
    twins = [twin for twin in [("payload", (last,)), *near, *drives] if twin not in known]
    if own[0] not in ("link_inertia", "payload", "torque_gain") or not twins:
        return finding
    probability = min(finding.probability, MAX_BODY_PROBABILITY)
    left = max(1 - probability - sum(rival.probability for rival in finding.alternatives), 0.0) / len(twins)
    rivals = (*finding.alternatives, *(Alternative(Law(EFFECTS[name], at), left, "") for name, at in twins))
    return replace(finding, probability=probability, alternatives=tuple(sorted(rivals, key=lambda x: -x.probability)))


def softened(finding: Finding) -> Finding:
    """Friction that falls off with the square of speed is no cause: it is the shape of Coulomb friction that rises."""
    if finding.law.effect.name != "quadratic_friction" or finding.law.parameters["coefficient"] >= 0:
        return finding
    return replace(finding, role="secondary", probability=min(finding.probability, MAX_BODY_PROBABILITY))


def stated_number_findings(
    dataset: Dataset, before: Prediction, selection: Selection, extended: ExtendedSimulation
) -> Iterator[Finding]:
    """Causes that are wrong numbers of stated laws, for a diagnosis without other causes.

    Either a law of the library is behind the residual, or only stated numbers are; in the second case, each refitted
    number is wrong or exactly as stated. `before` is the prediction of the simulation as given.
    """
    odds = selection.posterior.odds(selection.selected, selection.dispersion)[0]
    ratios = {key: float(np.exp(np.clip(x.log, -MAX_LOG_ODDS, MAX_LOG_ODDS))) for key, x in odds.items()}
    no_law = 1 / (1 + sum(ratios.values()))  # probability that no law of the library is behind the residual
    library = {key: (ratio / (1 + sum(ratios.values())), odds[key].best) for key, ratio in ratios.items()}
    wrong = {g: no_law * p for g, p in _wrong_probabilities(selection, extended).items()}
    own = {g: library.get(_key(g, library), (0.0, g))[0] for g in wrong}
    likely = {g: min(p + own[g], MAX_PROBABILITY) for g, p in wrong.items()}
    likely = {g: p for g, p in likely.items() if p >= tuned.CAUSE_PROBABILITY}
    if not likely:
        return
    given, after = before.held_out.residual, extended.prediction.held_out.residual
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
            threshold=float(np.log(tuned.CAUSE_PROBABILITY / (1 - tuned.CAUSE_PROBABILITY))),
            held_out_gain=1 - float(np.nanmean(after[:, joint] ** 2) / np.nanmean(given[:, joint] ** 2)),
            alternatives=tuple(_rivals(selection.posterior, group, fit.value[place], library)),
            stated=stated_numbers(dataset.model, whole),
        )


def body_finding(
    dataset: Dataset, before: Prediction, selection: Selection, extended: ExtendedSimulation
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
    strong = np.maximum(rms_of(before.train.torque), tuned.MIN_JOINT_SHARE * data.scale.max())
    usual = (
        1.0 if np.all(rms_of(before.train.residual) < tuned.USUAL_BODY_SHARE * strong) else 0.0
    )  # scale of no mismatch
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
    if min(share.max() / tuned.MIN_LAW_TORQUE_SHARE, wrong / tuned.CAUSE_PROBABILITY) < 1:
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
        threshold=float(np.log(tuned.CAUSE_PROBABILITY / (1 - tuned.CAUSE_PROBABILITY))),
        held_out_gain=1 - float(np.nanmean(after[:, joint] ** 2) / np.nanmean(given[:, joint] ** 2)),
        alternatives=tuple(
            Alternative(rival, x, "")
            for x, rival in sorted(rivals, key=lambda pair: -pair[0])
            if x > tuned.LISTED_PROBABILITY
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
    reported = dict[Group, tuple[Law, ...]]()
    for group, laws in extended.laws.items():
        model = extended.prediction.model if group in extended.kept else None
        curved = [isinstance(law.effect, TorqueLaw) and not is_plain(law.effect) for law in laws]
        known = [any(is_same(law, other) for other in given.laws) for law in laws]
        choices = zip(laws, curved, known, strict=True)
        reported[group] = tuple(total_law(law, given, model) if a and b else law for law, a, b in choices)
    return reported


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
        large = _share_of_step(selection.evidence, group, value).max() >= tuned.MIN_LAW_TORQUE_SHARE
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
        if probability > tuned.LISTED_PROBABILITY and key != own and rival.claim.laws and joint in data.rows(rival):
            rest = leave(torque, data.part(joint, rival))
            if rest @ rest <= tuned.RIVAL_RESIDUAL_SHARE * (torque @ torque):
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
