"""Model and session -> recording faults, before a fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..errors import OptionError
from ..estimation.excitation import ExcitationVerdict, judge_excitation
from ..estimation.least_squares import estimate
from ..model import Model
from ..regression.session import Part, Session
from ..types import Array, Mask
from .channels import judge_absolute, judge_channels
from .correction import Correction
from .evidence import FaultEvidence, Signals, gather
from .fits import FitColumns, unexplained
from .gains import Gains, judge_gains
from .lag import Lags, judge_lags
from .limits import judge_amount, judge_limits
from .messages import (
    KINDS,
    absolute_finding,
    amount_finding,
    channel_finding,
    claim_findings,
    excitation_findings,
    factor_findings,
    lag_findings,
    limit_finding,
    unexplained_finding,
    unsigned_unit_finding,
)
from .result import UNCERTAIN, RecordingFault, RecordingFaults
from .search import Claim, informative_torques, search

# [1] smallest unexplained share of a joint's torque that is a fault, and smallest deviation of that torque over the
# largest
UNEXPLAINED, STRONG = 0.6, 0.05
MOVES = 0.05  # [1] smallest rms velocity of that joint over the largest
CLEAR = 0.2  # [1] difference of unexplained shares by which the right sign or order is better than a wrong one
SIGNS, ORDERS = ("torque sign", "position sign", "axis"), ("torque order", "position order", "joint order")
REASONS = (*KINDS, "absolute torque", "units", "gain", "unexplained torque")  # possible causes of other findings
UNSIGNED = (0.1, 100.0)  # [1] range of absolute torque over predicted torque (rms) that friction can explain


class _Seen(NamedTuple):
    """Faults of signed torque."""

    informative: Mask  # (n,) joints with informative torque
    claims: list[Claim]
    done: Correction  # all corrections together
    left: Array  # (n,) [1] unexplained shares after them
    lags: Lags
    gains: Gains


def examine(
    model: Model, session: Session, excitation: ExcitationVerdict | None = None, signed: Mask | None = None
) -> RecordingFaults:
    """Find recording faults, by comparison with a simulation of the robot.

    A wrong order, sign, unit of angle or lag is claimed if its correction lets a passive joint with the model's bodies
    (with any friction, rotor and offset, not negative except the offset) explain the torque far better, in nearly all
    blocks of the recordings. For torques without a sign only their sizes are checked.

    Args:
        model: model of the session's joints.
        session: session by `prepare` with the recordings.
        excitation: verdict on the excitation of the recordings, if it exists already.
        signed: (n,) joints whose torque was recorded with its sign, if the session has recovered signs.

    Raises:
        OptionError: the model has other joints.
    """
    robot = session.robot
    if model.robot.joints != robot.joints:
        fact = f"the simulation moves {', '.join(model.robot.joints)}, the recordings {', '.join(robot.joints)}"
        raise OptionError(f"{fact}; give a simulation of the recorded joints")
    parts = list({id(recording): (recording, s) for recording, s in (*session.held_out, *session.train)}.values())
    evidence = gather(model, session, parts)
    if evidence is not None and signed is not None:
        evidence = replace(evidence, signed=evidence.signed & signed)
    absolute = list[RecordingFault]()
    if evidence is not None and (lost := judge_absolute(evidence, parts)).any():
        absolute = [absolute_finding([robot.joints[j] for j in np.flatnonzero(lost)])]
        evidence = replace(evidence, signed=evidence.signed & ~lost)
    seen = None if evidence is None else _see(evidence)
    causes = [*absolute, *_causes(session, parts, evidence, seen)]
    findings = [*causes, *_effects(session, parts, evidence, excitation, causes)]
    return _result(robot.joints, evidence, seen, findings)


def _see(evidence: FaultEvidence) -> _Seen:
    informative = informative_torques(evidence.plain, evidence.signed)
    claims = search(evidence, informative)
    done = claims[-1].correction if claims else Correction.none(len(informative))
    left, informative = unexplained(evidence.corrected(done)), informative[list(done.tau_from)]
    lags = judge_lags(evidence, done, informative)
    return _Seen(informative, claims, done, left, lags, judge_gains(evidence, done))


def _causes(
    session: Session, parts: Sequence[Part], evidence: FaultEvidence | None, seen: _Seen | None
) -> list[RecordingFault]:
    amount = judge_amount(session, parts)
    found = [] if amount.enough else [amount_finding(amount, len(session.robot.joints))]
    if evidence is not None and seen is not None:
        found += _torque_findings(evidence, seen)
    return [*found, *(channel_finding(fault, session.robot) for fault in judge_channels(parts))]


def _effects(
    session: Session,
    parts: Sequence[Part],
    evidence: FaultEvidence | None,
    excitation: ExcitationVerdict | None,
    causes: Sequence[RecordingFault],
) -> Iterator[RecordingFault]:
    """Findings on limits and excitation that no more severe fault can cause."""
    reasons = {joint for f in causes if f.kind in REASONS for joint in f.joints or session.robot.joints}
    for beyond in judge_limits(evidence, parts, session):
        if session.robot.joints[beyond.joint] not in reasons:
            yield limit_finding(beyond, session.robot)
    if evidence is not None and not reasons:
        yield from excitation_findings(_excitation(session) if excitation is None else excitation)


def _torque_findings(evidence: FaultEvidence, seen: _Seen) -> Iterator[RecordingFault]:
    robot, joints, x = evidence.robot, evidence.robot.joints, evidence.corrected(seen.done)
    yield from claim_findings(seen.claims, joints, len(np.unique(evidence.block)))
    yield from lag_findings(seen.lags, seen.done, joints)
    yield from factor_findings(seen.gains, robot)
    speed = np.sqrt(np.mean(x.v**2, axis=0))
    deviation = np.where(evidence.signed, np.std(x.torque, axis=0), 0.0)
    strong = (speed >= MOVES * speed.max()) & (deviation >= STRONG * deviation.max())
    lost = seen.informative & (seen.left >= UNEXPLAINED) & strong
    yield from (unexplained_finding(joints[j], 1 - float(seen.left[j])) for j in np.flatnonzero(lost))
    size, expected = (np.sqrt(np.mean(signal**2, axis=0)) for signal in (x.torque, x.predicted))
    silent = ~evidence.signed & (size > 0) & (expected > 0) & (expected >= UNSIGNED[0] * expected.max(initial=0.0))
    if silent.any():
        ratio = size[silent] / expected[silent]
        if ratio.max() < UNSIGNED[0] or ratio.min() > UNSIGNED[1]:
            yield unsigned_unit_finding(float(np.median(ratio)))


def _excitation(session: Session) -> ExcitationVerdict:
    factors = session.reduce(session.train)
    return judge_excitation(session.task, factors, estimate(factors, session.task.base))


def _result(
    joints: tuple[str, ...], evidence: FaultEvidence | None, seen: _Seen | None, findings: Sequence[RecordingFault]
) -> RecordingFaults:
    nothing, unknown = np.full(len(joints), np.nan), (UNCERTAIN,) * len(joints)
    if evidence is None or seen is None:
        return RecordingFaults(joints, nothing, nothing, nothing, unknown, unknown, tuple(findings))
    signs, order = _verdicts(evidence.corrected(seen.done), seen)
    late = seen.done.lag[list(seen.done.tau_from)] + seen.lags.own
    explained = np.where(evidence.signed, 1 - seen.left, np.nan)
    return RecordingFaults(joints, explained, seen.gains.factor, late, signs, order, tuple(findings))


def _verdicts(x: Signals, seen: _Seen) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Verdicts on signs and on order, by comparison with all others."""
    n, columns = len(seen.informative), [FitColumns(x, j) for j in range(len(seen.informative))]
    wrong = [{j for c in seen.claims if c.kind in kinds for j in c.joints} for kinds in (SIGNS, ORDERS)]
    signs: list[str] = []
    order: list[str] = []
    for j in range(n):
        other = columns[j].fit(-x.torque[:, j]).unexplained
        rest = [c.fit(s * x.torque[:, j]).unexplained for k, c in enumerate(columns) if k != j for s in (1, -1)]
        for verdicts, faulty, rival in ((signs, wrong[0], other), (order, wrong[1], min(rest, default=1.0))):
            right = seen.informative[j] and (n == 1 and verdicts is order or rival - seen.left[j] >= CLEAR)
            verdicts.append("wrong" if j in faulty else "right" if right else UNCERTAIN)
    return tuple(signs), tuple(order)
