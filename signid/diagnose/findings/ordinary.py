"""The ordinary: friction, rotor and offset of every joint, which a description does not state, and its bodies.

Where a description states no friction, or the same number in every joint, these are one block of columns with flat
priors beside every hypothesis, so that other laws are weighed with its coefficients integrated out.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from ...deadline import seconds_left
from ...effects import EFFECTS
from ...effects.law import law_torque
from ...model import Model
from ...regression.session import Session
from ...types import TWO_SIDED, Law
from ..data.column_groups import Group, rough_drives
from ..data.dataset import Dataset
from ..data.estimated_gains import EstimatedGain
from ..data.hypotheses import VARIABLE_NAMES
from ..data.locate import locate
from ..data.motions import pieces
from ..data.thresholds import MIN_LAW_TORQUE_SHARE
from ..evidence.bayes_factors import Evidence
from ..evidence.selection import Selection
from ..extend.extend import is_same
from ..extend.holdout import Prediction, ResidualRows, predict
from ..result import Alternative, Finding
from .held_out_selection import error_change
from .stated import MAX_LOG_ODDS, stated_numbers, torque_share
from .thresholds import EQUAL_PREDICTION_GAIN

ORDINARY_EFFECTS = ("coulomb_friction", "viscous_friction", "torque_offset", "armature")
FORM_EFFECTS = ("link_inertia", "asymmetric_friction", "stribeck_friction", "quadratic_friction", "presliding_friction")
MIN_START = 1e-6  # least start of friction and rotors [their units]: zero numbers are no columns
ROUGH_LAWS = 2  # laws that begin at estimates, since other laws, such as a delay, change their torque
MIN_PLACEHOLDER_JOINTS = 3  # joints in which equal friction is a placeholder, at least
CLEAR_DEVIATIONS = 3.0  # from zero, from which an offset or a rotor is fitted beside laws [std]; heuristic
MAX_BODY_PROBABILITY = 0.9  # probability of one changed body where all may be wrong, at most [1]; heuristic
ORDINARY_SHARE = 0.2  # prior rms torque of an ordinary law over its joint's [1]; heuristic


def with_ordinary(model: Model, session: Session, skip: Collection[str]) -> tuple[Model, tuple[Law, ...]]:
    """Description with the ordinary laws that it does not state, at rough numbers, and the laws of the block.

    Without change where friction is stated, where the model was identified, or where no time is left to fit them.
    """
    stated = [law for law in model.laws if law.effect.dissipative and any(law.effect.coefficients(law.parameters))]
    assumed = _placeholders(model, stated)
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


def _placeholders(model: Model, stated: Sequence[Law]) -> tuple[Law, ...]:
    """Stated friction that is the same number in every joint, and so nobody's measurement; else none."""
    numbers = {(law.effect.name, *law.parameters.values()) for law in stated}
    everywhere = len({law.joints for law in stated}) == len(model.robot.joints) >= MIN_PLACEHOLDER_JOINTS
    return tuple(stated) if len(numbers) == 1 and everywhere else ()


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
    worse = error_change(fewer.held_out, extended.held_out) > EQUAL_PREDICTION_GAIN
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
        if odds < 0 or share[joint] < MIN_LAW_TORQUE_SHARE or inside:
            continue
        yield Finding(
            law=law,
            std={key: float(np.sqrt(variance))},
            role="cause",
            probability=float(1 / (1 + np.exp(-odds))),
            torque_share=share,
            where=locate(dataset.table, joint, column * step, bool(given.robot.prismatic[joint]), VARIABLE_NAMES[:-1]),
            statistic=odds,
            threshold=0.0,
            held_out_gain=_gain(extended.held_out, replace(law, parameters={key: step}), joint),
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


def _gain(rows: ResidualRows, law: Law, joint: int) -> float:
    """Share of the held-out sum of squares at a joint that the torque of a law of the extended model removes."""
    made = [rows.thin(law_torque(law, piece.motion)[1][:, :1]) for piece in rows.pieces]
    after, torque = rows.residual[:, joint], np.concatenate(made)[:, 0]
    return 1 - float(np.nansum(after**2)) / max(float(np.nansum((after + torque) ** 2)), 1e-300)
