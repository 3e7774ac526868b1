"""Greedy search for corrections with which the model explains the torque far better."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ..deadline import time_is_up
from ..types import Array, Frozen, Mask
from .distortions import nats
from .evidence import Correction, FaultEvidence, agreement, unexplained, unexplained_by_others
from .lag_and_gain import LATE, lag_table
from .result import REFUSE, WARN, RecordingFault, named, percent

DEGREES = 'convert it to radians, or write [units] q = "deg", on two lines, into a column map (--columns)'
TURNS = 'convert it to radians, or write [units] q = "rev", on two lines, into a column map (--columns)'
METRES = 'convert it to metres, or write [units] q = "mm", on two lines, into a column map (--columns)'
CLAIMS = {  # kind -> fault of some joints, correction that was tried, advice
    "torque sign": ("the torque of {} has the wrong sign", "negated", "negate the column"),
    "position sign": ("the position of {} has the wrong sign", "negated", "negate the column"),
    "axis": (
        "{} turns in the opposite direction to the description",
        "with position and torque negated",
        "negate both columns, or reverse the axis in the description",
    ),
    "torque order": ("the torques of {} are exchanged", "put in order", "rename the columns"),
    "position order": ("the positions of {} are exchanged", "put in order", "rename the columns"),
    "joint order": ("positions and torques of {} are exchanged", "put in order", "rename the columns"),
    "degrees": ("the position of {} is in degrees", "in radians", DEGREES),
    "revolutions": ("the position of {} is in revolutions", "in radians", TURNS),
    "millimetres": ("the position of {} is in millimetres", "in metres", METRES),
    "lag": ("the torque of {} is late or early", "shifted", "shift the column"),
}
DIAGNOSABLE = ("torque sign", "torque order", "lag")  # faults that a diagnosis can handle, since it has laws for them
SEARCH = "the search for recording faults"
WELL, CLOSELY = 0.05, 0.01  # [1] unexplained share of a good fit, and of the criterion for ties
# [nats] smallest reduction of the log unexplained variance by a claim; tolerance for rivals
LEAST_GAIN, NEARLY = 0.8, 0.3
LEFT, BETTER = 0.35, 0.5  # [1] largest unexplained share after a claim, and over that before it, on some joint
WORSE = 0.25  # [1] increase of the unexplained share of any joint from which on a correction is rejected
AGREE = 0.8  # [1] smallest share of blocks in which a claim improves the fit
WIDE = 2 * np.pi  # smallest range of a position in degrees; smaller ones are radians, or a motion of a few degrees
UNITS = {"degrees": np.pi / 180, "revolutions": 2 * np.pi, "millimetres": 1e-3}


class CorrectionTrial(NamedTuple):
    """Candidate correction."""

    kind: str
    joints: tuple[int, ...]
    correction: Correction


@dataclass(frozen=True, eq=False)
class Claim(Frozen):
    """Accepted correction."""

    kind: str
    joints: tuple[int, ...]
    correction: Correction  # including those before it
    before: float  # [1] unexplained share of the variance, mean over the joints whose torque it improves
    after: float  # [1] the same after the correction
    agreement: float  # [1] share of the blocks in which it improves the fit
    rivals: tuple[CorrectionTrial, ...] = ()  # equally good corrections


def search(evidence: FaultEvidence, informative: Mask) -> list[Claim]:
    """Find all claims, each the best one after those before it; informative: (n,) joints with informative torque."""
    claims, done = list[Claim](), Correction.none(len(informative))
    for _ in range(2 * len(informative)):
        if time_is_up(SEARCH, answer=False):
            break
        if (claim := _next(evidence, done, informative)) is None:
            break
        claims, done = [*claims, claim], claim.correction
    return claims


def _next(evidence: FaultEvidence, done: Correction, informative: Mask) -> Claim | None:
    before = _left(evidence, done)
    if nats(before, informative, WELL) - informative.sum() * np.log(WELL) < LEAST_GAIN:
        return None
    evaluated = []  # rank (smaller is better), candidate, unexplained shares
    for trial in _trials(evidence, done, informative[list(done.tau_from)]):
        if time_is_up(SEARCH, answer=False):
            return None
        left = _left(evidence, trial.correction)
        # An exchange improves all informative torques of its joints: an improvement of one may be chance
        own = [k for k in (done.tau_from[j] for j in trial.joints) if informative[k]] if "order" in trial.kind else []
        if np.any((left - before)[evidence.signed] > WORSE) or any(left[k] > max(before[k], WELL) for k in own):
            continue
        evaluated.append(((nats(left, informative, WELL), nats(left, informative, CLOSELY)), trial, left))
    if not evaluated:
        return None
    evaluated.sort(key=lambda one: (round(one[0][0], 1), one[0][1]))
    rank, best, left = evaluated[0]
    if best.kind == "lag" and np.abs(best.correction.lag - done.lag).max() < LATE:
        return None
    betters = np.flatnonzero(informative & (left <= BETTER * before))
    if nats(before, informative, WELL) - rank[0] < LEAST_GAIN or not np.any(left[betters] <= LEFT):
        return None
    before_it, after_it = (evidence.corrected(correction) for correction in (done, best.correction))
    joints, moved = ([c.tau_from.index(k) for k in betters.tolist()] for c in (done, best.correction))
    share = agreement(before_it, after_it, evidence.block, joints, moved)
    if share < AGREE:
        return None
    rivals = (trial for other, trial, _ in evaluated[1:] if np.all(np.subtract(other, rank) < NEARLY))
    shares = float(before[betters].mean()), float(left[betters].mean())
    return Claim(*best, *shares, share, tuple(rivals))


def _left(evidence: FaultEvidence, correction: Correction) -> Array:
    """Unexplained shares (n,) [1] of the torques' variances, in the order of the recording's columns."""
    out = np.empty(len(correction.tau_from))
    out[list(correction.tau_from)] = unexplained(evidence.corrected(correction))
    return out


def _trials(evidence: FaultEvidence, done: Correction, informative: Mask) -> Iterator[CorrectionTrial]:
    from scipy.optimize import linear_sum_assignment  # its import takes longer than all other checks

    n, prismatic = len(informative), evidence.robot.prismatic
    for i in range(n):
        if informative[i]:
            yield CorrectionTrial("torque sign", (i,), done.scale((i,), torque=-1))
        yield CorrectionTrial("position sign", (i,), done.scale((i,), position=-1))
        yield CorrectionTrial("axis", (i,), done.scale((i,), position=-1, torque=-1))
    if n > 1:  # found one by one, they may look like something else
        everyone = tuple(range(n))
        yield CorrectionTrial("torque sign", everyone, done.scale(everyone, torque=-1))
        yield CorrectionTrial("position sign", everyone, done.scale(everyone, position=-1))
    cost, both = np.where(np.eye(n), 0.0, 2.0), np.outer(informative, informative)
    cost[both] = unexplained_by_others(evidence.corrected(done)).min(axis=2)[both]
    order = tuple(linear_sum_assignment(cost)[1].tolist())  # torques by the joint that explains them best, of any sign
    moved = tuple(i for i in range(n) if order[i] != i)
    if len(moved) > 2:
        yield CorrectionTrial("torque order", moved, done.exchange(order, torques=True))
    for i, j in combinations(range(n), 2):
        swapped = tuple(j if k == i else i if k == j else k for k in range(n))
        if informative[i] and informative[j]:
            yield CorrectionTrial("torque order", (i, j), done.exchange(swapped, torques=True))
        yield CorrectionTrial("position order", (i, j), done.exchange(swapped, positions=True))
        yield CorrectionTrial("joint order", (i, j), done.exchange(swapped, positions=True, torques=True))
    for unit, scale in UNITS.items():
        which = tuple(np.flatnonzero(prismatic == (unit == "millimetres")).tolist())
        for joints in sorted({which, *((j,) for j in which)} - {()}):
            if unit != "degrees" or np.ptp(evidence.q[:, list(joints)], axis=0).max() > WIDE:
                yield CorrectionTrial(unit, joints, done.scale(joints, position=scale))
    lags, left = lag_table(evidence, done)
    for joints in sorted({tuple(range(n)), *((j,) for j in np.flatnonzero(informative).tolist())}):
        own = left[:, [j for j in joints if informative[j]]]
        best = int(np.argmin(np.log(np.maximum(own, CLOSELY)).sum(axis=1)))
        if lags[best]:
            yield CorrectionTrial("lag", joints, done.earlier(joints, float(lags[best])))


def claim_faults(claims: Sequence[Claim], joints: Sequence[str], blocks: int) -> Iterator[RecordingFault]:
    """One finding per kind of sign or unit, and one per exchange; lags have their own findings."""
    groups: dict[tuple[str, int], list[Claim]] = {}
    for k, claim in enumerate(claims):
        if claim.kind != "lag":
            groups.setdefault((claim.kind, k if "order" in claim.kind else -1), []).append(claim)
    for (kind, _), group in groups.items():
        about = tuple(joints[j] for j in sorted({j for claim in group for j in claim.joints}))
        rivals = [] if len(group) > 1 else [(r.kind, tuple(joints[j] for j in r.joints)) for r in group[0].rivals]
        before, after = (float(np.mean([getattr(c, key) for c in group])) for key in ("before", "after"))
        sure = min(claim.agreement for claim in group)
        fault, how, advice = CLAIMS[kind]
        gain = f"model and friction explain {percent(1 - after)} of the torque instead of {percent(1 - before)}"
        better = f"better in {round(sure * blocks)} of {blocks} blocks of the recordings"
        others = [CLAIMS[rival][0].format(named(who)) for rival, who in rivals if rival != "lag"][:3]
        likely = f" (equally likely: {'; '.join(others)})" if others else ""
        sentence = f"{fault.format(named(about))}: {how}, {gain} ({better}); {advice}{likely}"
        mild = kind in DIAGNOSABLE or any(rival in DIAGNOSABLE for rival, _ in rivals)
        measures = {"explained_before": 1 - before, "explained_after": 1 - after, "agreement": sure}
        yield RecordingFault(kind, about, WARN if mild else REFUSE, measures, sentence, tuple(rivals))
