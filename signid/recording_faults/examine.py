"""Model and session -> recording faults, before a fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..errors import OptionError
from ..estimation.excitation import ExcitationVerdict, judge_excitation
from ..estimation.least_squares import estimate
from ..model import Model, stated_inertials, stated_laws
from ..regression.session import Part, Session
from ..robot import with_gravity
from ..types import Array, Mask, Robot
from . import messages
from .channels import judge_absolute, judge_amount, judge_channels, judge_limits
from .distortions import KINDS as DISTORTIONS, Distortion, distortion_fault, find_distortion, nats
from .evidence import Correction, FaultEvidence, Signals, gather
from .fits import informative_torques, unexplained, unexplained_by_others
from .gravity import GravityEstimate, Weights, find_gravity, under_gravity, weigh
from .lag_and_gain import Gains, Lags, judge_gains, judge_lags
from .result import REFUSE, UNCERTAIN, RecordingFault, RecordingFaults
from .samples import SAMPLE_KINDS, judge_samples
from .search import Claim, search
from .standstill import judge_standstills

# [1] smallest unexplained share of a joint's torque that is a fault, and smallest deviation of that torque over the
# largest
UNEXPLAINED, STRONG = 0.6, 0.05
MOVES = 0.05  # [1] smallest rms velocity of that joint over the largest
CLEAR = 0.2  # [1] difference of unexplained shares by which the right sign or order is better than a wrong one
USABLE = 0.5  # [1] smallest share of bodies with mass, for the description to be used as a simulation
UNFIT = "unexplained torque"
SIGNS, ORDERS = ("torque sign", "position sign", "axis"), ("torque order", "position order", "joint order")
# possible causes of other findings
REASONS = (*messages.KINDS, "absolute torque", "units", "gain", UNFIT, *SAMPLE_KINDS, *DISTORTIONS)
WEAK = 0.2  # [1] unexplained share after a claim, from which on it is chance if another torque remains unexplained
AS_WELL = 0.9  # [nats] difference of log unexplained shares up to which gravity and a fault explain torque equally well
UNSIGNED = (0.1, 100.0)  # [1] range of absolute torque over predicted torque (rms) that friction can explain


class _Seen(NamedTuple):
    """Faults of signed torque."""

    evidence: FaultEvidence
    informative: Mask  # (n,) joints with informative torque
    claims: list[Claim]
    done: Correction  # all corrections together
    signals: Signals  # after them
    left: Array  # (n,) [1] unexplained shares after them
    lags: Lags
    gains: Gains
    distortion: Distortion | None
    weights: Weights
    gravity: GravityEstimate | None = None  # if it explains the torque as well as any fault
    rivals: tuple[RecordingFault, ...] = ()  # faults that explain it as well as gravity


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
    robot = session.robot
    if model.robot.joints != robot.joints:
        fact = f"the simulation moves {', '.join(model.robot.joints)}, the recordings {', '.join(robot.joints)}"
        raise OptionError(f"{fact}; give a simulation of the recorded joints")
    used = list({id(recording): (recording, s) for recording, s in (*session.held_out, *session.train)}.values())
    parts = list(session.whole) or used  # a part of a recording does not contain its own reverse
    findings = judge_samples(parts, robot, session.task.band.per_joint)
    broken = any(fault.severity == REFUSE for fault in findings)  # other statements would be about these samples
    evidence, seen = None if broken else evidence or gather(model, session, parts, signed), None
    if evidence is not None and (stuck := judge_standstills(evidence, parts)):
        findings, broken, evidence = [*findings, *stuck], True, None
    if evidence is not None:
        if (lost := judge_absolute(evidence, parts)).any():
            findings.append(messages.absolute_finding([robot.joints[j] for j in np.flatnonzero(lost)]))
            evidence = replace(evidence, signed=evidence.signed & ~lost)
        seen = _see(evidence)
    amount = judge_amount(session, used)
    findings += [] if amount.enough or broken else [messages.amount_finding(amount, len(robot.joints))]
    if seen is not None:
        known = {joint for fault in findings if fault.kind in SAMPLE_KINDS for joint in fault.joints}
        findings += [f for f in _torque_findings(seen) if not (f.kind == UNFIT and known.issuperset(f.joints))]
    findings += judge_channels(parts, robot)
    findings += _limits_and_excitation(findings, session, evidence, parts, excitation)
    if seen is None:
        nothing, unknown = np.full(len(robot.joints), np.nan), (UNCERTAIN,) * len(robot.joints)
        return RecordingFaults(robot.joints, nothing, nothing, nothing, unknown, unknown, tuple(findings), nothing)
    late = seen.done.lag[list(seen.done.tau_from)] + seen.lags.own
    explained = np.where(seen.evidence.signed, 1 - seen.left, np.nan)
    faulty = [j for claim in seen.claims for j in claim.joints]
    weight = np.where(seen.weights.strong & (seen.distortion is None), seen.weights.share, np.nan)
    weight[faulty] = np.nan
    return RecordingFaults(robot.joints, explained, seen.gains.factor, late, *_verdicts(seen), tuple(findings), weight)


def _limits_and_excitation(
    findings: Sequence[RecordingFault],
    session: Session,
    evidence: FaultEvidence | None,
    parts: Sequence[Part],
    excitation: ExcitationVerdict | None,
) -> Iterator[RecordingFault]:
    """Faults that matter only without a more severe one that can be their cause."""
    robot = session.robot
    reasons = {joint for f in findings if f.kind in REASONS for joint in f.joints or robot.joints}
    yield from (fault for fault in judge_limits(evidence, parts, robot) if fault.joints[0] not in reasons)
    if evidence is not None and not reasons:
        if excitation is None:
            factors = session.reduce(session.train)
            excitation = judge_excitation(session.task, factors, estimate(factors, session.task.base))
        yield from messages.excitation_findings(excitation)


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
    return gather(Model(session.robot, inertials, stated_laws(session.robot)), session, list(session.whole), signed)


def under_found_gravity(robot: Robot, evidence: FaultEvidence | None) -> Mounted | None:
    """Robot under another gravity than the stated one, if it is the only explanation of the torque.

    A fit under the given gravity would be about another robot, so this is asked before.
    """
    if evidence is None or find_gravity(evidence) is None or (seen := _see(evidence)).gravity is None:
        return None
    fault = messages.gravity_finding(seen.gravity, seen.rivals, evidence)
    return Mounted(with_gravity(robot, [fault.measures[k] for k in "xyz"]), fault) if is_sole(fault) else None


def is_sole(fault: RecordingFault) -> bool:
    """Whether gravity is the only explanation of the torque."""
    return not fault.alternatives and not fault.measures["single"]


def _see(evidence: FaultEvidence) -> _Seen:
    """Faults under the given gravity, or under the one that explains the torque as well or better."""
    seen = _see_faults(evidence)
    found = find_gravity(evidence)
    rest = nats(seen.left, seen.informative)
    if found is None or rest < found.left - AS_WELL:
        return seen
    named = [f for f in _torque_findings(seen) if f.kind not in (UNFIT, "units", "gain")]
    rivals = tuple(named) if rest <= found.left + AS_WELL else ()
    return _see_faults(under_gravity(evidence, found.value))._replace(gravity=found, rivals=rivals)


def _see_faults(evidence: FaultEvidence) -> _Seen:
    informative = informative_torques(evidence.plain, evidence.signed)
    claims, nothing = search(evidence, informative), Correction.none(len(informative))
    done = claims[-1].correction if claims else nothing
    left, own = unexplained(evidence.corrected(done)), informative[list(done.tau_from)]
    if claims and max(claim.after for claim in claims) > WEAK and np.any(left[own] >= UNEXPLAINED):
        claims, done, left, own = [], nothing, unexplained(evidence.plain), informative
    distortion = find_distortion(evidence, informative, nats(left, own))
    if distortion is not None:
        claims, done, own = [], nothing, informative
    signals = evidence.corrected(done) if distortion is None else distortion.signals
    lags, gains = judge_lags(evidence, done, own), judge_gains(evidence, done)
    return _Seen(evidence, own, claims, done, signals, unexplained(signals), lags, gains, distortion, weigh(evidence))


def _torque_findings(seen: _Seen) -> Iterator[RecordingFault]:
    evidence, x, joints = seen.evidence, seen.signals, seen.evidence.robot.joints
    if seen.gravity is not None:
        yield messages.gravity_finding(seen.gravity, seen.rivals, evidence)
    if seen.distortion is not None:
        yield distortion_fault(seen.distortion, joints, len(np.unique(evidence.block)))
        return
    if seen.gravity is None and not seen.claims:
        yield from messages.weight_findings([joints[j] for j in np.flatnonzero(seen.weights.only)])
    yield from messages.claim_findings(seen.claims, joints, len(np.unique(evidence.block)))
    yield from messages.lag_findings(seen.lags, seen.done, joints)
    yield from messages.factor_findings(seen.gains, evidence.robot)
    speed = np.sqrt(np.mean(x.v**2, axis=0))
    deviation = np.where(evidence.signed, np.std(x.torque, axis=0), 0.0)
    strong = (speed >= MOVES * speed.max()) & (deviation >= STRONG * deviation.max())
    lost = seen.informative & (seen.left >= UNEXPLAINED) & strong
    yield from (messages.unexplained_finding(joints[j], 1 - float(seen.left[j])) for j in np.flatnonzero(lost))
    size, expected = (np.sqrt(np.mean(signal**2, axis=0)) for signal in (x.torque, x.predicted))
    silent = ~evidence.signed & (size > 0) & (expected > 0) & (expected >= UNSIGNED[0] * expected.max(initial=0.0))
    if silent.any():
        ratio = size[silent] / expected[silent]
        if ratio.max() < UNSIGNED[0] or ratio.min() > UNSIGNED[1]:
            yield messages.unsigned_unit_finding(float(np.median(ratio)))


def _verdicts(seen: _Seen) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Verdicts on signs and on order, by comparison with all others."""
    x, n = seen.signals, len(seen.informative)
    others = unexplained_by_others(x)
    wrong = [{j for c in seen.claims if c.kind in kinds for j in c.joints} for kinds in (SIGNS, ORDERS)]
    signs, order = list[str](), list[str]()
    for j in range(n):
        rest = np.delete(others[:, j], j, axis=0).min(initial=1.0)
        for verdicts, faulty, rival in ((signs, wrong[0], others[j, j, 1]), (order, wrong[1], rest)):
            right = seen.informative[j] and (n == 1 and verdicts is order or rival - seen.left[j] >= CLEAR)
            verdicts.append("wrong" if j in faulty else "right" if right else UNCERTAIN)
    return tuple(signs), tuple(order)
