"""Findings: the selected laws with numbers, places and alternatives, the extended simulation, and warnings on it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...deadline import time_is_up
from ...effects import EFFECTS
from ...effects.base import TorqueLaw
from ...effects.empirical import MOTION_VARIABLES, POINTS
from ...effects.law import coefficient_count, law_columns
from ...effects.naming import law_name, law_place
from ...errors import shorten
from ...estimation.fit_quality import MIN_R2, Fit
from ...model import Model
from ...regression.session import Session
from ...simulation.excite.families import Fourier, random_parameters
from ...simulation.excite.limits import build_limits
from ...simulation.excite.separation import EQUAL_LAW_SHARE, law_distance, wide_columns, with_torque
from ...simulation.rollout import RollOut
from ...types import Array, Frozen, Law, Shape
from .. import thresholds as tuned
from ..data.dataset import Dataset
from ..data.estimated_gains import EstimatedGain
from ..data.hypotheses import VARIABLE_NAMES
from ..data.locate import Location, locate
from ..data.noise import Noise
from ..data.rows import Group
from ..evidence.selection import Selection
from ..holdout import Prediction, ResidualRows, fit_of, predict
from ..result import Alternative, Finding, Unexplained, without_cause
from ..search.stepwise import LAW_SEARCH, required_log_odds
from .alternatives import Contender
from .held_out_selection import ExtendedSimulation, select_on_held_out
from .intervals import extended_covariance, standard_deviations
from .stated import (
    FORM_EFFECTS,
    beside_wrong_bodies,
    block_of,
    body_finding,
    ordinary_findings,
    reported_laws,
    softened,
    stated_number_findings,
    stated_numbers,
    torque_share,
    total_law,
    without_vague,
)
from .verdict import Verdict, undecided_words

VAGUE_LAW = "its numbers could all be zero"
TOO_FEW = "the rows are too few to hold any out"
UNSUPPORTED = "the held-out recordings are not predicted better with it"
UNCAUSED_FLAG = "the causes of the mismatch were not found, so the simulation stays as it was given"
Deviations = Mapping[Group, Sequence[Mapping[str, float]]]  # standard deviations of the numbers of each law
MOTION_SEARCH, UNSEARCHED_NOTE = "the search for motions that separate alternatives", "not searched for: time was up"
TRIED_MOTIONS, MOTION_DURATION, MOTION_RATE = 6, 8.0, 50.0  # random ones, [s], [Hz]
MOTION_HARMONICS, AMPLITUDE_SHARES = 5, (0.3, 0.9)  # least and most share of the limits

FALLBACK_FLAG = (
    "the search was cut short, and with the laws found so far the held-out torque of {} is predicted worse than by the "
    "given simulation: model.json holds the given simulation and the findings are leads; diagnose again with more time"
)


class Conclusions(NamedTuple):
    """Verdict, findings and extended simulation."""

    verdict: str  # nothing_missing, named, unknown or undecided
    prediction: Prediction  # of the extended simulation
    findings: tuple[Finding, ...]
    unexplained: tuple[Unexplained, ...]
    located: tuple[Location, ...]
    tolerance: float
    flags: tuple[str, ...]


def conclude(
    dataset: Dataset,
    session: Session,
    selection: Selection,
    contenders: Sequence[Contender],
    verdict: Verdict,
    *,
    seed: int,
    given: Model,
    ordinary: Sequence[Law] = (),
) -> Conclusions:
    """Extend the simulation, and report each selected law with its numbers and alternatives.

    `given` is the simulation without the ordinary laws.
    """
    order, block = [*verdict.causes, *verdict.secondary], block_of(selection, ordinary)
    extended = select_on_held_out(session, dataset.model, selection, order, block)
    stds = standard_deviations(dataset, selection, reported_laws(dataset.model, extended))
    contenders = [_with_held_out(one, extended, stds, session.judges_itself) for one in contenders]
    verdict = _revised(verdict, contenders, extended, session.judges_itself)
    prediction = extended.prediction
    before: Prediction | None = None
    if order or block:
        covariance = extended_covariance(prediction.model, selection, extended)
        prediction = prediction._replace(model=replace(prediction.model, covariance=covariance))
    reporter = _Reporter(dataset, selection, extended, stds, verdict.causes, seed, session.judges_itself)
    by_group = {contender.group: contender for contender in contenders}
    shown = {*verdict.causes, *verdict.secondary}
    findings = list(reporter.findings([by_group[group] for group in verdict.ranked if group in shown]))
    usual = list(ordinary_findings(given, dataset, selection, extended.prediction, ordinary))
    if not verdict.causes and usual:
        verdict = replace(verdict, name="named" if verdict.name == "nothing_missing" else verdict.name)
    elif not verdict.causes:
        before, known = predict(session, dataset.model), dataset.model.misfit is not None
        if known or verdict.name == "unknown":
            stated = list(stated_number_findings(dataset, before, selection, extended))
            changed = known and any(finding.probability > tuned.CHANGED_PROBABILITY for finding in stated)
        else:
            stated = list(body_finding(dataset, before, selection, extended))
            changed = bool(stated)
        findings = [*stated, *findings]
        verdict = replace(verdict, name="named") if changed else verdict
    gains = [law.joints[0] for law in ordinary if isinstance(law.effect, EstimatedGain)]
    added = [law for law in ordinary if not isinstance(law.effect, EstimatedGain)]
    if usual or gains:
        findings = [beside_wrong_bodies(finding, dataset.table.joints, gains) for finding in findings]
    if usual:
        findings = [softened(replace(x, ordinary=x.law.effect.name in FORM_EFFECTS)) for x in findings]
        findings = sorted([*findings, *usual], key=lambda finding: (finding.ordinary, finding.role != "cause"))
        prediction = without_vague(session, prediction, added, usual)
    judged = prediction
    if not any(finding.role == "cause" for finding in findings):  # numbers refitted beside no cause fit the noise
        prediction = before if before is not None and given is dataset.model else predict(session, given)
        known = selection.evidence.informed or selection.prior_scale > 1  # else bodies deviate as they usually do
        judged = prediction if known else judged
        findings = [replace(finding, in_model=False, refused=finding.refused or UNCAUSED_FLAG) for finding in findings]
    floor, scale = selection.data.floor, selection.data.scale
    given_residual = dataset.table.residual.copy()
    for law in (law for law in ordinary if law not in given.laws):
        for j, torque in dataset.torque(law).items():
            given_residual[:, j] += torque
    unexplained = tuple(_unexplained(dataset, judged, verdict))
    if verdict.name == "named" and without_cause(findings, unexplained):
        verdict = replace(verdict, name="unknown")
    short = list(undecided_words(dataset, session, judged.train, verdict))
    verdict = replace(verdict, name="undecided") if short else verdict
    return Conclusions(
        verdict=verdict.name,
        prediction=prediction,
        findings=tuple(findings),
        unexplained=unexplained,
        located=tuple(_place(dataset, j, given_residual[:, j]) for j in range(dataset.table.joints)),
        tolerance=float(np.max(np.sqrt(verdict.threshold / selection.data.counts) * floor / scale)),
        flags=(*short, *_flags(dataset, findings, verdict, session.judges_itself, unexplained)),
    )


def _with_held_out(contender: Contender, extended: ExtendedSimulation, stds: Deviations, reused: bool) -> Contender:
    """Add the held-out evidence; refuse a law that is not in the extended simulation or whose numbers are vague.

    `reused`: whether the training rows take the place of held-out rows, which then refuse nothing.
    """
    group = contender.group
    vague = all(map(_is_vague, extended.laws[group], stds[group]))
    return contender.with_held_out(extended.log_bayes[group], vague or (group not in extended.kept and not reused))


def _revised(verdict: Verdict, contenders: Sequence[Contender], extended: ExtendedSimulation, reused: bool) -> Verdict:
    """Revise the verdict by the held-out rows: drop improbable laws, promote corrections, demote causes."""
    weak = {contender.group for contender in contenders if contender.probability < tuned.CAUSE_PROBABILITY}
    for group in () if reused else (*verdict.causes, *verdict.secondary):
        refused = group not in extended.kept and extended.log_bayes[group] <= 0
        if refused and verdict.is_quiet(verdict.contributions.data.rows(group)):
            weak.add(group)
    return verdict.without(weak).with_promoted(contenders, extended.gain).with_demoted(extended.kept)


def _is_vague(law: Law, std: Mapping[str, float]) -> bool:
    """Whether every coefficient of a law is near zero, for its standard deviation."""
    keys = law.effect.linear()
    return bool(keys) and all(abs(law.parameters[key]) < tuned.VAGUE_DEVIATIONS * std.get(key, 0.0) for key in keys)


@dataclass(frozen=True, eq=False)
class _Reporter(Frozen):
    """Data that findings are made from."""

    dataset: Dataset
    selection: Selection
    extended: ExtendedSimulation
    stds: Deviations
    causes: Sequence[Group]
    seed: int
    reused: bool = False  # whether the training rows take the place of held-out rows

    def findings(self, contenders: Sequence[Contender]) -> Iterator[Finding]:
        """One finding for each law of some hypotheses, with a limited number of separating motions."""
        left = tuned.MAX_MOTIONS
        for contender in contenders:
            for law, std in zip(self.extended.laws[contender.group], self.stds[contender.group], strict=True):
                rivals = tuple(self.alternatives(contender, law, left))
                left -= sum(bool(rival.separating_motion) for rival in rivals)
                yield self.finding(contender, law, std, rivals)

    def finding(
        self, contender: Contender, law: Law, std: Mapping[str, float], rivals: tuple[Alternative, ...]
    ) -> Finding:
        """Finding of one law of a hypothesis."""
        dataset, selection, group = self.dataset, self.selection, contender.group
        in_model = group in self.extended.kept
        usual = tuned.FIRST_LOG_ODDS if len(selection.selected) == 1 else tuned.NEXT_LOG_ODDS
        whole = total_law(law, dataset.model, self.extended.prediction.model if in_model else None)
        torque = dataset.torque(law)
        share = torque_share(torque, selection.data.scale)
        loudest = max(torque, key=lambda j: share[j])
        joint = law.joints[0] if len(law.joints) <= 2 and law.joints[0] in torque else loudest
        timed = any(kind.unit == "s" for kind in law.effect.parameters.values() if isinstance(kind, Shape))
        return Finding(
            law=whole,
            std=std,
            role="cause" if group in self.causes else "secondary",
            probability=contender.probability,
            torque_share=share,
            where=_place(dataset, joint, torque[joint], VARIABLE_NAMES if timed else VARIABLE_NAMES[:-1]),
            statistic=float(selection.log_odds[group]),
            threshold=required_log_odds(selection.posterior, group, float(selection.prior_scale == 0), 0, usual),
            held_out_gain=self.extended.gain[group],
            alternatives=rivals,
            stated=stated_numbers(dataset.model, whole),
            in_model=in_model,
            refused="" if in_model else VAGUE_LAW if _is_vague(law, std) else TOO_FEW if self.reused else UNSUPPORTED,
        )

    def alternatives(self, contender: Contender, law: Law, most: int) -> Iterator[Alternative]:
        """Rivals of a law, the most probable first; at most `most` plausible ones with a separating motion."""
        model, floor, most = self.dataset.model, self.selection.data.floor, min(most, tuned.MOTIONS_PER_FINDING)
        for k, (probability, group) in enumerate(contender.rivals.values()):
            for rival in group.claim.laws[:1]:
                sought = k < most and probability > tuned.PLAUSIBLE_PROBABILITY
                motion = tell_apart(model, law, rival, floor, self.seed) if sought else ""
                yield Alternative(rival, probability, motion)


def _place(dataset: Dataset, joint: int, torque: Array, variables: Sequence[str] = VARIABLE_NAMES) -> Location:
    return locate(dataset.table, joint, torque, bool(dataset.model.robot.prismatic[joint]), variables)


def _unexplained(dataset: Dataset, prediction: Prediction, verdict: Verdict) -> Iterator[Unexplained]:
    """Joints whose training residual exceeds the threshold with the extended simulation."""
    train = prediction.train
    residual, torque = np.nan_to_num(train.residual), np.nan_to_num(train.torque)
    excess = np.sum((residual / train.irreducible_std(dataset.noise, 1)) ** 2 - 1, axis=0)
    for joint in np.flatnonzero(excess > verdict.threshold).tolist():
        share = float(np.sqrt(np.mean(residual[:, joint] ** 2) / max(float(np.mean(torque[:, joint] ** 2)), 1e-300)))
        yield Unexplained(joint, _place(dataset, joint, residual[:, joint]), share)


def _flags(
    dataset: Dataset,
    findings: Sequence[Finding],
    verdict: Verdict,
    reused: bool,
    unexplained: Sequence[Unexplained] = (),
) -> Iterator[str]:
    """Warnings on the findings, one sentence each."""
    robot = dataset.model.robot
    if verdict.name == "unknown":
        named = any(finding.role == "cause" for finding in findings)
        lead = "the named causes leave more torque than they explain: " if named else ""
        if named and (rest := without_cause(findings, unexplained)):
            lead = f"the named causes do not act on {shorten([robot.joints[x.joint] for x in rest])}: "
        yield (
            f"{lead}something is missing that no effect of the library explains; "
            "the report says what it depends on, not what it is"
        )
    if out := list(dict.fromkeys(law_name(finding.law, robot) for finding in findings if not finding.in_model)):
        explain, are = ("explains", "it is") if len(out) == 1 else ("explain", "they are")
        why = "but not by enough for so few rows" if reused else "but not the held-out recordings"
        yield f"{shorten(out)} {explain} the training recordings, {why}: {are} not in the extended simulation"
    for finding in findings:
        named_above = not finding.in_model
        unsure = finding.probability < tuned.SURE_PROBABILITY and not named_above and not finding.ordinary
        if finding.role == "cause" and unsure and verdict.name == "named":
            rivals = ", ".join(f"{law_name(a.law, robot)} ({a.probability:.0%})" for a in finding.alternatives[:3])
            yield (
                f"{law_name(finding.law, robot)} {tuned.AMBIGUOUS_WORDS} "
                f"({finding.probability:.0%}); the others: {rivals or 'no effect of the library'}"
            )


def tell_apart(model: Model, law: Law, rival: Law, floor: Array, seed: int) -> str:
    """Along which of some random motions a rival explains least of a law; floor: (n,) noise of torque [N.m or N].

    Source: T-optimality, Atkinson, Fedorov, Biometrika 62(1), 1975.
    """
    if time_is_up(MOTION_SEARCH):
        return UNSEARCHED_NOTE
    usual = [Law(effect, (j,)) for effect in EFFECTS if effect.usual and effect is not law.effect for j in law.joints]
    rng, t = np.random.default_rng(seed), np.arange(int(MOTION_DURATION * MOTION_RATE)) / MOTION_RATE
    limits, family = build_limits(model.robot), Fourier(MOTION_DURATION, MOTION_HARMONICS, 1 / MOTION_DURATION)
    basis = family.basis(t)
    drawn = (random_parameters(basis, limits, rng, AMPLITUDE_SHARES) for _ in range(TRIED_MOTIONS))
    motions = [with_torque(model, family.sample(model.robot.joints, x, t)) for x in drawn]
    tried = [  # with the usual laws fitted beside, at the joints of the first law
        (*law_distance(law, rival, motion, wide_columns(usual, motion), floor), motion) for motion in motions
    ]
    left, share, motion = max(tried, key=lambda t: t[0])
    if max(s for _, s, _ in tried) < EQUAL_LAW_SHARE:
        torques = all(isinstance(x.effect, TorqueLaw) for x in (rival, law)) and rival.joints == law.joints
        if torques and coefficient_count(rival) > coefficient_count(law):
            return f"no motion can distinguish them: it does what {law.effect.name} does, by more numbers"
        return "no motion can distinguish them; another sensor or a known load is needed"
    acting = (*law.joints, *rival.joints)
    joints = acting if len(acting) < len(model.robot.joints) else range(len(model.robot.joints))
    joint = max(joints, key=lambda j: float(np.ptp(motion.q[:, j])))
    unit, names = "m" if model.robot.prismatic[joint] else "rad", ",".join(_written(model, x) for x in (law, rival))
    q, v = motion.q[:, joint], motion.v[:, joint]
    return (
        f"{model.robot.joints[joint]} from {q.min():.2g} to {q.max():.2g} {unit} at up to {np.abs(v).max():.2g} "
        f"{unit}/s, all joints moving: a random motion of {MOTION_DURATION:g} s sets them {np.sqrt(left):.2g} standard "
        f"deviations apart; signid excite ROBOT --separate {names} finds a better one"
    )


def _written(model: Model, law: Law) -> str:
    joint, values = law_place(law, model.robot)
    where = "" if joint is None or law.effect.scope == "tip" else f"@{joint}"
    return f"{law.effect.name}{where}" + (f":partner={values['partner']}" if "partner" in values else "")


def add_empirical_torque(session: Session, result: Conclusions) -> Conclusions:
    """Add a piecewise linear torque for unexplained torque to the simulation where it predicts the held-out rows."""
    prediction, out, laws = result.prediction, list[Unexplained](), list[Law]()
    for one in result.unexplained:
        if one.place.variable not in MOTION_VARIABLES:
            out.append(one)
            continue
        law = _empirical_law(prediction.train, one)
        x, y = _columns(prediction.train, law), np.nan_to_num(prediction.train.residual[:, one.joint])
        gram = x.T @ x
        value = np.linalg.solve(
            gram + tuned.CORRELATED_ROWS * np.eye(len(gram)), x.T @ y
        )  # ridge: shrunk where rows are few
        held_out = np.nan_to_num(prediction.held_out.residual[:, one.joint])
        after = held_out - _columns(prediction.held_out, law) @ value
        gain = 1 - float(after @ after) / max(float(held_out @ held_out), 1e-300)
        modelled = gain > tuned.EMPIRICAL_GAIN and not session.judges_itself
        if modelled:
            values = {f"value_{k}": float(v) for k, v in zip(POINTS, value, strict=True)}
            laws.append(replace(law, parameters={**law.parameters, **values}))
        out.append(replace(one, held_out_gain=gain, modelled=modelled))
    if laws:
        prediction = predict(session, replace(prediction.model, laws=(*prediction.model.laws, *laws)))
    return result._replace(prediction=prediction, unexplained=tuple(out))


def keep_given_if_worse(given: Prediction, result: Conclusions, noise: Noise, floor: Array) -> Conclusions:
    """Keep the given simulation, with a flag, if a search that was cut short predicts some joint worse.

    floor: (n,) [N.m or N] rms of white measurement noise in the band.
    """
    if not time_is_up(LAW_SEARCH):
        return result
    before, after = fit_of(given, noise, floor), fit_of(result.prediction, noise, floor)
    worse = [joint for k, joint in enumerate(after.joints) if _is_worse(before, after, k)]
    if not worse:
        return result
    unexplained = tuple(replace(one, modelled=False) for one in result.unexplained)
    flag = FALLBACK_FLAG.format(", ".join(worse))
    return result._replace(prediction=given, unexplained=unexplained, flags=(*result.flags, flag))


def holdout_warnings(before: Fit, after: Fit) -> Iterator[str]:
    """One sentence for each joint that is predicted worse than before, or hardly at all."""
    for k, joint in enumerate(after.joints):
        then, now = before.held_out_rms[k], after.held_out_rms[k]
        if _is_worse(before, after, k):
            yield (
                f"the torque of {joint} on held-out recordings is predicted worse than before "
                f"({then:.3g} -> {now:.3g} {after.unit[k]}): do not use the extended simulation for it"
            )
        elif after.held_out_r2[k] < MIN_R2 and now > tuned.LOUD_RATIO * after.irreducible_rms[k]:
            yield (
                f"the extended simulation still predicts little of the torque of {joint} on held-out recordings "
                f"(R2 {after.held_out_r2[k]:.2f}): what is missing there was not found"
            )


def _is_worse(before: Fit, after: Fit, k: int) -> bool:
    now = after.held_out_rms[k]
    return bool(now > tuned.WORSE_RMS * before.held_out_rms[k] and now > tuned.LOUD_RATIO * after.irreducible_rms[k])


def _empirical_law(rows: ResidualRows, one: Unexplained) -> Law:
    """Empirical law without values, with knots between quantiles and equal distances of the variable."""
    index = MOTION_VARIABLES.index(one.place.variable)
    motions = [piece.motion for piece in rows.pieces]
    signal = np.concatenate([(m.q, m.v, m.a, m.load)[index][:, one.joint] for m in motions])
    share = np.linspace(0, 1, len(POINTS))
    knots = (np.quantile(signal, share) + signal.min() + share * np.ptp(signal)) / 2  # near the rows, but not too close
    knots = knots + np.arange(len(knots)) * 1e-9 * max(float(np.ptp(signal)), 1e-9)  # keeps knots distinct
    shape = {f"knot_{k}": float(x) for k, x in zip(POINTS, knots, strict=True)}
    return Law(EFFECTS["empirical"], (one.joint,), {"variable": float(index), **shape})


def _columns(rows: ResidualRows, law: Law) -> Array:
    """(M, k) low-passed columns of the law at its joint [1]."""
    return np.concatenate([rows.thin(law_columns(law, piece.motion)[1][:, 0]) for piece in rows.pieces])


def rollout_warnings(before: RollOut | None, after: RollOut | None) -> Iterator[str]:
    """One sentence for each joint whose simulation by the extended model leaves the held-out motion faster.

    A joint counts where its median error at the end of the windows grew by the factor `WORSE_ROLLOUT`, and the mean log
    ratio over windows is positive by `SURE_ERRORS` standard errors.
    """
    if before is None or after is None:
        return
    horizon = max(after.horizons)
    errors = [np.clip(np.abs(one.end(horizon)), 1e-12, 1e12) for one in (before, after)]
    for k, joint in enumerate(after.joints):
        first, last = (error[:, k] for error in errors)
        if len(first) < tuned.MIN_WINDOWS or np.isnan(last).any():
            continue
        ratio, grown = np.log(last / first), float(np.median(last) / np.median(first))
        if grown > tuned.WORSE_ROLLOUT and ratio.mean() > tuned.SURE_ERRORS * ratio.std() / np.sqrt(len(ratio)):
            yield (
                f"the extended simulation leaves the held-out motion of {joint} faster than the given one (median "
                f"error of roll-outs of {horizon:g} s: {grown:.2f} times); simulate {joint} with care, and record more "
                f"motions"
            )
