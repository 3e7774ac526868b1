"""Model and session -> recording faults, before a fit: one list of checks, each with what it needs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..errors import OptionError
from ..estimation.excitation import ExcitationVerdict, judge_excitation
from ..estimation.least_squares import estimate
from ..model import Model, stated_inertials, stated_laws
from ..regression.session import Part, Session
from ..robot import with_gravity
from ..types import Array, Mask, Robot
from .channels import SAMPLE_KINDS, judge_samples, longest_rows, true_runs
from .distortions import KINDS as DISTORTIONS, DistortionSearch, distortion_fault, find_distortion, nats
from .evidence import (
    Correction,
    FaultEvidence,
    Signals,
    amount_fault,
    fit_passive,
    gather,
    informative_torques,
    judge_amount,
    unexplained,
    unexplained_by_others,
)
from .gravity import GravityEstimate, Weights, find_gravity, gravity_fault, under_gravity, weigh, weight_fault
from .result import NOTE, REFUSE, UNCERTAIN, WARN, RecordingFault, RecordingFaults, named, percent
from .search import CLAIMS, Claim, Gains, Lags, claim_faults, factor_faults, judge_gains, judge_lags, lag_faults, search

# [1] smallest unexplained share of a joint's torque that is a fault; smallest deviation of that torque over the
# largest; smallest rms velocity of that joint over the largest
UNEXPLAINED, DEVIATES, MOVES = 0.6, 0.05, 0.05
SHARE_MARGIN = 0.2  # [1] difference of unexplained shares by which the right sign or order is better than a wrong one
USABLE = 0.5  # [1] smallest share of bodies with mass, for the description to be used as a simulation
CHANCE = 0.2  # [1] unexplained share after a claim, from which on it is chance if another torque remains unexplained
AS_WELL = 0.9  # [nats] difference of log unexplained shares up to which gravity and a fault explain torque equally well
UNSIGNED = (0.1, 100.0)  # [1] range of absolute torque over predicted torque (rms) that friction can explain
UNFIT = "unexplained torque"
SIGNS, ORDERS = ("torque sign", "position sign", "axis"), ("torque order", "position order", "joint order")
# kinds that can be the cause of values beyond limits, and of insufficient excitation
CAUSES = (*CLAIMS, "absolute torque", "units", "gain", UNFIT, *SAMPLE_KINDS, *DISTORTIONS)
# Absolute torque: largest minimum of the torque over its maximum [1]; smallest share of the rows with the rarer sign of
# the predicted torque [1]; number of joints without negative torque that friction cannot explain; largest residual of
# the absolute predicted torque, over the residual of the signed one, and over the torque (sums of squares) [1]
TOUCH_RATIO, BOTH, SEVERAL = 0.02, 0.1, 2
ABSOLUTE_RATIO, ABSOLUTE_REST = 0.5, 0.2
LIMIT_EXCESS = 0.05  # [ranges, or rad or m] excess of a position that is a rounding error of the description
STRONGER, FASTER, FAULT_RATIO = 1.05, 1.2, 1.5  # [1] tolerated torque and velocity over their limits; faulty torque
LIMITS = {  # units of a revolute and of a prismatic joint; what to check
    "torque": (("N.m", "N"), "its unit"),
    "velocity": (("rad/s", "m/s"), "time and unit"),
    "position": (("rad", "m"), "its zero and unit"),
}


class TorqueComparison(NamedTuple):
    """Signed torque compared with the model, after all corrections."""

    evidence: FaultEvidence
    informative: Mask  # (n,) joints with informative torque
    claims: list[Claim]
    done: Correction  # all corrections together
    signals: Signals  # after them
    left: Array  # (n,) [1] unexplained shares after them
    lags: Lags
    gains: Gains
    search: DistortionSearch
    weights: Weights
    gravity: GravityEstimate | None = None  # if it explains the torque as well as any fault
    rivals: tuple[RecordingFault, ...] = ()  # faults that explain it as well as gravity


@dataclass
class Case:
    """Recordings, and the faults that the checks have found so far."""

    model: Model
    session: Session
    excitation: ExcitationVerdict | None
    signed: Mask | None  # (n,) joints whose torque was recorded with its sign, of a session with recovered signs
    described: FaultEvidence | None
    found: list[RecordingFault] = field(default_factory=list)

    @cached_property
    def used(self) -> list[Part]:
        """Parts to learn from and held-out parts, each recording once."""
        parts = (*self.session.held_out, *self.session.train)
        return list({id(recording): (recording, s) for recording, s in parts}.values())

    @cached_property
    def parts(self) -> list[Part]:
        """Whole recordings, since a part of a recording does not contain its own reverse."""
        return list(self.session.whole) or self.used

    @cached_property
    def evidence(self) -> FaultEvidence | None:
        """Rows to compare with the model; None if all recordings are too short."""
        return self.described or gather(self.model, self.session, self.parts, self.signed)

    @cached_property
    def comparison(self) -> TorqueComparison:
        """Torque compared with the model."""
        assert self.evidence is not None, "checks that compare need evidence"
        return _compare(self.evidence)

    @property
    def sound(self) -> bool:
        """Whether no fault of the samples rules out a comparison with the model."""
        return not any(fault.severity == REFUSE and fault.kind in SAMPLE_KINDS for fault in self.found)

    @property
    def compared(self) -> FaultEvidence | None:
        """Evidence of sound samples."""
        return self.evidence if self.sound else None


def examine(
    model: Model,
    session: Session,
    excitation: ExcitationVerdict | None = None,
    signed: Mask | None = None,
    evidence: FaultEvidence | None = None,
) -> RecordingFaults:
    """Find recording faults, by comparison with a simulation of the robot.

    A wrong order, sign, unit of angle or lag is claimed if its correction lets a passive joint with the model's bodies
    (with any friction, rotor and offset, not negative except the offset) explain the torque far better, in nearly all
    blocks of the recordings. For torques without a sign only their sizes are checked. If the session has recovered
    signs, signed: (n,) are the joints whose torque was recorded with its sign. evidence: what `described_evidence` has
    gathered for this session; None: it is gathered with the model.

    Raises:
        OptionError: the model has other joints.
    """
    joints = session.robot.joints
    if model.robot.joints != joints:
        fact = f"the simulation moves {', '.join(model.robot.joints)}, the recordings {', '.join(joints)}"
        raise OptionError(f"{fact}; give a simulation of the recorded joints")
    case = Case(model, session, excitation, signed, evidence)
    _look(case)
    if case.compared is None:
        nothing, unknown = np.full(len(joints), np.nan), (UNCERTAIN,) * len(joints)
        return RecordingFaults(joints, nothing, nothing, nothing, unknown, unknown, tuple(case.found), nothing)
    seen = case.comparison
    late = seen.done.lag[list(seen.done.tau_from)] + seen.lags.own
    explained = np.where(seen.evidence.signed, 1 - seen.left, np.nan)
    weight = np.where(seen.weights.strong & (seen.search.found is None), seen.weights.share, np.nan)
    weight[[j for claim in seen.claims for j in claim.joints]] = np.nan
    others, signs, order = unexplained_by_others(seen.signals), list[str](), list[str]()
    wrong = [{j for c in seen.claims if c.kind in kinds for j in c.joints} for kinds in (SIGNS, ORDERS)]
    for j in range(len(joints)):  # verdicts on sign and order, by comparison with all others
        rest = np.delete(others[:, j], j, axis=0).min(initial=1.0)
        for verdicts, faulty, rival in ((signs, wrong[0], others[j, j, 1]), (order, wrong[1], rest)):
            alone = len(joints) == 1 and verdicts is order
            right = seen.informative[j] and (alone or rival - seen.left[j] >= SHARE_MARGIN)
            verdicts.append("wrong" if j in faulty else "right" if right else UNCERTAIN)
    factor, tried, findings = seen.gains.factor, seen.search.tried, tuple(case.found)
    return RecordingFaults(joints, explained, factor, late, tuple(signs), tuple(order), findings, weight, tried)


def _look(case: Case) -> None:
    """Add the findings of all checks; later ones see what earlier ones have found."""
    session, robot, parts = case.session, case.session.robot, case.parts
    case.found += judge_samples(parts, robot)
    if (evidence := case.compared) is not None:
        case.found += judge_standstills(evidence, parts)
        if case.sound and (lost := absolute_torques(evidence, parts)).any():  # compared by their size from here on
            case.evidence = replace(evidence, signed=evidence.signed & ~lost)
            joints = tuple(robot.joints[j] for j in np.flatnonzero(lost))
            fact = f"the torque of {named(joints)} is never negative although the predicted torque changes its sign"
            advice = "these are absolute values: name the columns abs_tau_JOINT, or use --unsigned"
            case.found.append(RecordingFault("absolute torque", joints, REFUSE, {}, f"{fact}; {advice}"))
    if case.sound and not (amount := judge_amount(session, case.used)).enough:
        case.found.append(amount_fault(amount, len(robot.joints)))
    if case.compared is not None:
        damaged = {joint for fault in case.found if fault.kind in SAMPLE_KINDS for joint in fault.joints}
        faults = _torque_faults(case.comparison)
        case.found += [f for f in faults if not (f.kind == UNFIT and damaged.issuperset(f.joints))]
    if any(recording.static for recording, _ in parts):
        return
    case.found += [f for f in judge_limits(case.compared, parts, robot) if f.joints[0] not in _caused(case)]
    if case.compared is not None and not _caused(case):
        if (excitation := case.excitation) is None:
            factors = session.reduce(session.train)
            excitation = judge_excitation(session.task, factors, estimate(factors, session.task.base))
        measures = {"share": float(excitation.shares[0]) if len(excitation.shares) else 0.0}
        for sentence in excitation.sentences:
            case.found.append(RecordingFault("excitation", excitation.resting, WARN, measures, sentence))


def _caused(case: Case) -> set[str]:
    """Joints with a fault that can be the cause of others."""
    robot = case.session.robot
    return {joint for f in case.found if f.kind in CAUSES for joint in f.joints or robot.joints}


class Mounted(NamedTuple):
    """A robot in the field of gravity that its recordings show."""

    robot: Robot
    fault: RecordingFault


def described_evidence(session: Session, signed: Mask) -> FaultEvidence | None:
    """Evidence with the description as model; None if all recordings are too short, or too few bodies have mass.

    signed: (n,) as in `examine`.
    """
    inertials = stated_inertials(session.robot)
    if np.mean(inertials[:, 0] > 0) < USABLE:
        return None
    return gather(Model(session.robot, inertials, stated_laws(session.robot)), session, session.whole, signed)


def under_found_gravity(robot: Robot, evidence: FaultEvidence | None) -> Mounted | None:
    """Robot under another gravity than the stated one, if it is the only explanation of the torque.

    A fit under the given gravity would be about another robot, so this is asked before.
    """
    if evidence is None or find_gravity(evidence) is None or (seen := _compare(evidence)).gravity is None:
        return None
    fault = gravity_fault(seen.gravity, seen.rivals, evidence)
    return Mounted(with_gravity(robot, [fault.measures[k] for k in "xyz"]), fault) if is_sole(fault) else None


def is_sole(fault: RecordingFault) -> bool:
    """Whether gravity is the only explanation of the torque."""
    return not fault.alternatives and not fault.measures["single"]


def _compare(evidence: FaultEvidence) -> TorqueComparison:
    """Faults under the given gravity, or under the one that explains the torque as well or better."""
    seen = _compare_under_gravity(evidence)
    other = find_gravity(evidence)
    rest = nats(seen.left, seen.informative)
    if other is None or rest < other.left - AS_WELL:
        return seen
    rivals = [f for f in _torque_faults(seen) if f.kind not in (UNFIT, "units", "gain")]
    equal = tuple(rivals) if rest <= other.left + AS_WELL else ()
    return _compare_under_gravity(under_gravity(evidence, other.value))._replace(gravity=other, rivals=equal)


def _compare_under_gravity(evidence: FaultEvidence) -> TorqueComparison:
    informative = informative_torques(evidence.plain, evidence.signed)
    claims, nothing = search(evidence, informative), Correction.none(len(informative))
    done = claims[-1].correction if claims else nothing
    left, moved = unexplained(evidence.corrected(done)), informative[list(done.tau_from)]
    if claims and max(claim.after for claim in claims) > CHANCE and np.any(left[moved] >= UNEXPLAINED):
        claims, done, left, moved = [], nothing, unexplained(evidence.plain), informative
    tried = find_distortion(evidence, informative, nats(left, moved))
    if (distortion := tried.found) is not None:
        claims, done, moved = [], nothing, informative
    signals = evidence.corrected(done) if distortion is None else distortion.signals
    lags, gains = judge_lags(evidence, done, moved), judge_gains(evidence, done)
    left = unexplained(signals)
    return TorqueComparison(evidence, moved, claims, done, signals, left, lags, gains, tried, weigh(evidence))


def _torque_faults(seen: TorqueComparison) -> Iterator[RecordingFault]:
    evidence, x, joints = seen.evidence, seen.signals, seen.evidence.robot.joints
    blocks = len(np.unique(evidence.block))
    if seen.gravity is not None:
        yield gravity_fault(seen.gravity, seen.rivals, evidence)
    if seen.search.found is not None:
        yield distortion_fault(seen.search.found, joints, blocks)
        return
    if seen.gravity is None and not seen.claims and seen.weights.only.any():
        yield weight_fault([joints[j] for j in np.flatnonzero(seen.weights.only)])
    yield from claim_faults(seen.claims, joints, blocks)
    yield from lag_faults(seen.lags, seen.done, joints)
    yield from factor_faults(seen.gains, evidence.robot)
    speed = np.sqrt(np.mean(x.v**2, axis=0))
    deviation = np.where(evidence.signed, np.std(x.torque, axis=0), 0.0)
    strong = (speed >= MOVES * speed.max()) & (deviation >= DEVIATES * deviation.max())
    for j in np.flatnonzero(seen.informative & (seen.left >= UNEXPLAINED) & strong):
        explained = 1 - float(seen.left[j])
        fact = f"the torque of {joints[j]} does not follow from its motion"
        fact = f"{fact}: model and friction explain {percent(explained)} of it"
        advice = "check that the column is measured, not commanded, and belongs to the joint"
        yield RecordingFault(UNFIT, (joints[j],), WARN, {"explained": explained}, f"{fact}; {advice}")
    size, expected = (np.sqrt(np.mean(signal**2, axis=0)) for signal in (x.torque, x.predicted))
    silent = ~evidence.signed & (size > 0) & (expected > 0) & (expected >= UNSIGNED[0] * expected.max(initial=0.0))
    ratio = size[silent] / expected[silent]
    if silent.any() and (ratio.max() < UNSIGNED[0] or ratio.min() > UNSIGNED[1]):
        middle = float(np.median(ratio))
        fact = f"absolute torques are {middle:.3g} times the predicted ones: their unit is wrong"
        yield RecordingFault("units", (), WARN, {"factor": middle}, f"{fact}; convert them to N.m (N)")


def absolute_torques(evidence: FaultEvidence, parts: Sequence[Part]) -> Mask:
    """Mask (n,) of joints with absolute values in a signed torque column.

    If at least one joint shows it, all joints whose torque is never negative are included.
    """
    predicted, torque = evidence.plain.predicted, evidence.plain.torque
    rarer = np.minimum((predicted > 0).mean(axis=0), (predicted < 0).mean(axis=0))
    sizes, plain = (np.sum((torque - p) ** 2, axis=0) for p in (np.abs(predicted), predicted))
    if not np.any(evidence.signed & (rarer >= BOTH) & (sizes <= plain)):
        return np.zeros_like(evidence.signed)
    raw = np.concatenate([np.nan_to_num(longest_rows(part).tau) for part in parts])
    least, most = raw.min(axis=0), raw.max(axis=0)
    never = evidence.signed & (least >= 0) & (most > 0)
    touches = never & (least <= TOUCH_RATIO * most) & (rarer >= BOTH)
    alike = (sizes <= ABSOLUTE_RATIO * plain) & (sizes <= ABSOLUTE_REST * np.sum(torque**2, axis=0))
    lost = touches & (alike | ((touches & (sizes < plain)).sum() >= SEVERAL))
    return np.asarray(never if lost.any() else lost)


def judge_limits(evidence: FaultEvidence | None, parts: Sequence[Part], robot: Robot) -> Iterator[RecordingFault]:
    """Values beyond the limits of the description, with a tolerance for noise."""
    low, high, travel = robot.lower, robot.upper, robot.upper - robot.lower
    bottom, top = np.min([s.lower for _, s in parts], axis=0), np.max([s.upper for _, s in parts], axis=0)
    room = LIMIT_EXCESS * np.maximum(1.0, np.where(np.isfinite(travel), travel, 1.0))
    above, over = top - high >= low - bottom, (low < high) & ((top > high + room) | (bottom < low - room))
    reached_limits = [("position", np.where(above, top, bottom), np.where(above, high, low), over)]
    if evidence is not None:
        speed = np.abs(evidence.plain.v).max(axis=0)
        torque = np.max([np.abs(curve.x).max(axis=0) for curve in evidence.torques], axis=0)
        for kind, value, limit, most in (
            ("velocity", speed, robot.velocity_limit, FASTER),
            ("torque", torque, robot.effort_limit, STRONGER),
        ):
            reached_limits.append((kind, value, limit, (limit > 0) & (value > most * limit)))
    for kind, value, limit, exceeded in reached_limits:
        units, check = LIMITS[kind]
        for j in np.flatnonzero(exceeded):
            reached = f"{value[j]:.4g} {units[int(robot.prismatic[j])]}, beyond its limit of {limit[j]:.4g}"
            sentence = f"the {kind} of {robot.joints[j]} reaches {reached}; check {check}, or correct the description"
            severity = WARN if kind == "torque" and value[j] >= FAULT_RATIO * limit[j] else NOTE
            measures = {"value": float(value[j]), "limit": float(limit[j])}
            yield RecordingFault(f"{kind} limit", (robot.joints[j],), severity, measures, sentence)


LONG = 1.0  # [s] smallest duration of a standstill
# [1] smallest variation of the torque that the model does not explain in standstills, over the torque's variation
# elsewhere. Friction at rest alone varies less than that of a moving joint
MUCH = 0.6
# A joint also rests by static friction, which is about as large as the friction of the moving joint: quantiles of the
# torque that the model does not explain, largest static friction over their half range, and smallest share of rows
# beyond it
RANGE, BREAKAWAY, BEYOND = (2.0, 98.0), 1.5, 0.05
MIN_STANDSTILL_ROWS = 20  # rows in standstills, and elsewhere


def judge_standstills(evidence: FaultEvidence, parts: Sequence[Part]) -> Iterator[RecordingFault]:
    """Faults of joints with signed torque whose position stands still for a second or longer, and moves elsewhere.

    A joint that rests by static friction is no fault: it holds any torque up to its breakaway friction. A joint whose
    sensor is stuck needs more or less.
    """
    raw = [longest_rows(part) for part in parts]
    times, ends = evidence.moments, np.cumsum([len(t) for t in evidence.moments])
    for j, joint in enumerate(evidence.robot.joints):
        still, seconds = np.zeros(len(evidence.q), dtype=bool), 0.0  # rows in standstills; the longest one [s]
        runs = [(rows.t, a, b) for rows in raw for a, b in true_runs(np.diff(rows.q[:, j]) == 0)]
        for at, a, b in ((at, a, b) for at, a, b in runs if at[b] - at[a] >= LONG):
            seconds = max(seconds, float(at[b] - at[a]))
            for t, end in zip(times, ends, strict=True):
                if at[0] <= t[0] and t[-1] <= at[-1]:
                    still[end - len(t) : end] |= (t > at[a]) & (t < at[b])
        if not evidence.signed[j] or min(still.sum(), (~still).sum()) < MIN_STANDSTILL_ROWS:
            continue
        x, at_rest = (Signals(*(signal[rows][:, [j]] for signal in evidence.plain)) for rows in (~still, still))
        gain = float(fit_passive(x).gain[0, 0])
        rest = at_rest.torque - gain * at_rest.predicted
        share = float(np.std(rest)) / max(float(np.std(x.torque)), 1e-300)
        low, high = np.percentile(x.torque - gain * x.predicted, RANGE)
        beyond = float(np.mean(np.abs(rest - (low + high) / 2) > BREAKAWAY * (high - low) / 2))
        if gain > 0 and share >= MUCH and beyond >= BEYOND:
            fact = f"the position of {joint} stands still for {seconds:.2g} s while its torque varies as if it moved"
            advice = "the sensor is stuck: check it, or cut that part out"
            measures = {"seconds": seconds, "share": share, "beyond": beyond}
            yield RecordingFault("stuck position", (joint,), REFUSE, measures, f"{fact}; {advice}")
