"""Evidence -> distortion of whole recordings: positions scaled or shifted, time scaled or reversed, torque nonlinear.

Each distortion is undone in turn. The best one is a fault if a passive joint with the model's bodies then explains the
torque far better than before, on several joints or nearly completely, in nearly all blocks of the recordings.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import log
from typing import NamedTuple

import numpy as np

from ..deadline import time_is_up
from ..regression.motion import Motion
from ..types import Array, Frozen, Indices, Mask
from .evidence import LAG, SPRING, FaultEvidence, Signals, agreement, missing_laws, unexplained
from .result import REFUSE, WARN, RecordingFault

SEARCH = "the search for distorted recordings"
# [1] unexplained share that no distortion is needed for, and [nats] smallest reduction of the log unexplained shares.
# Measured: at most 1.2 on real and simulated arms, 2.7 and more for distortions of the 3r
FLOOR, LEAST_GAIN = 2e-3, 1.8
MUCH, BETTER = 0.35, 0.5  # [1] largest unexplained share over that before: of one joint, and of others that improve
GOOD = 0.1  # [1] largest unexplained share of these joints after the correction
AGREE = 0.8  # [1] smallest share of blocks in which the correction improves the fit
FACTORS = (0.1, 0.25, 1 / 3, 0.5, 0.7, 1.4, 2.0, 3.0, 4.0, 10.0)  # [1] on the position of a joint
TIMES = (0.25, 1 / 3, 0.5, 0.7, 1.4, 2.0, 3.0, 4.0)  # [1] on all velocities
ANGLES = tuple(15 * k for k in range(-11, 13) if abs(15 * k) >= 45)  # [degrees]; diagnosis has a law for smaller ones
FINER = (0.84, 0.92, 1.09, 1.19)  # [1] factors around the best one
POWERS = (0.5, 2.0)  # [1] that undo a square and a square root
# Long lags: [1] unexplained share of a joint from which on they are tried; [s] longest one; [1] its longest share of a
# recording; [s] step of the candidates, and number of finer steps in it
BAD, LONGEST, PART, STEP, BETWEEN = 0.1, 10.0, 0.4, 0.04, 8
ROWS = 400  # rows with which candidates are compared
TIE = 0.1  # [nats] difference up to which clocks are alike, since rotors can replace inertia: the nearest one is named
KINDS = {  # kind -> fault, correction that was tried, advice
    "position scale": (
        "the position of {joint} is about {times:.2g} times too {size}",
        "scaled",
        "check its unit, gear ratio and counts per turn",
    ),
    "position zero": (
        "the position of {joint} is off by about {angle:.0f} degrees",
        "shifted",
        "set its zero to that of the description, or add the offset to the column",
    ),
    "clock": (
        "the column t runs {times:.2g} times too {pace} or more, or the inertias of the description are too {size}",
        "with that time",
        "check the unit of t and the sampling rate",
    ),
    "square root": ("all torques seem to be square roots of torques", "squared", "record the torque itself"),
    "square": ("all torques seem to be squares of torques", "with their square roots", "record the torque itself"),
    "reversed torque": ("the torque runs backwards in time", "reversed", "reverse the order of its rows"),
    "reversed positions": ("the positions run backwards in time", "reversed", "reverse the order of their rows"),
    "reversed time": ("the recording runs backwards in time", "reversed", "reverse the order of its rows"),
    "long lag": (
        "the torque of all joints is recorded {lag:.2f} s {side} against the motion",
        "shifted",
        "record both with one clock, or shift the columns by that time",
    ),
}
AMBIGUOUS = ("clock", "long lag")  # a diagnosis is still of use


@dataclass(frozen=True, eq=False)
class Distortion(Frozen):
    """Distortion that explains the torque far better."""

    kind: str
    joints: tuple[int, ...]  # empty: all
    value: float  # factor, angle [degrees] or lag [s]
    before: float  # [1] mean unexplained share of the improved joints
    after: float  # [1] the same after the correction
    agreement: float  # [1] share of the blocks in which it improves the fit
    signals: Signals  # after the correction
    law: str = ""  # missing law that explains the torque as well


class _Trial(NamedTuple):
    kind: str
    joint: int  # -1: all
    value: float


def nats(left: Array, informative: Mask, floor: float = FLOOR) -> float:
    """Sum of the log unexplained shares, left: (n,) [1], of informative torques; a small one does not count."""
    return float(np.sum(np.log(np.maximum(left[informative], floor))))


def find_distortion(evidence: FaultEvidence, informative: Mask, rest: float) -> Distortion | None:
    """Find the best distortion, if it leaves fewer nats than the best correction of order, sign and lag, `rest`."""
    before = unexplained(evidence.plain)
    if min(nats(before, informative), rest) - informative.sum() * log(FLOOR) < LEAST_GAIN:
        return None
    few, found = thinned(evidence)[0], dict[_Trial, float]()
    for trial in _trials(evidence, bool(np.any(before[informative] >= BAD))):
        if time_is_up(SEARCH, answer=False):
            return None
        found[trial] = nats(unexplained(_undone(few, trial)[0]), informative)
    best = min(found, key=lambda trial: found[trial])
    if rest - found[best] < LEAST_GAIN / 2:  # few rows: roughly
        return None
    for trial in _finer(best):
        found[trial] = nats(unexplained(_undone(few, trial)[0]), informative)
    alike = [t for t, left in found.items() if t.kind == best.kind and left <= min(found.values()) + TIE]
    best = min(alike, key=lambda t: abs(log(t.value))) if best.kind == "clock" else min(found, key=lambda t: found[t])
    return _judged(evidence, informative, best, rest)


def thinned(evidence: FaultEvidence) -> tuple[FaultEvidence, Indices]:
    """Evidence of every n-th row, up to `ROWS`, and the numbers of these rows."""
    every = -(-len(evidence.q) // ROWS)
    moments = tuple(t[::every] for t in evidence.moments)
    starts = np.cumsum([0, *(len(t) for t in evidence.moments)])[:-1]
    kept = np.concatenate(
        [start + np.arange(0, len(t), every) for start, t in zip(starts, evidence.moments, strict=True)]
    )
    plain, block = evidence.plain.rows(kept), evidence.block[kept]
    few = replace(evidence, q=evidence.q[kept], plain=plain, moments=moments, block=block)
    return few, kept


def _judged(evidence: FaultEvidence, informative: Mask, trial: _Trial, rest: float) -> Distortion | None:
    signals, rows = _undone(evidence, trial)
    plain, block = evidence.plain.rows(rows), evidence.block[rows]
    before, after = unexplained(plain), unexplained(signals)
    ratio = np.where(informative, after / np.maximum(before, 1e-300), 1.0)
    betters = np.flatnonzero(ratio <= BETTER)
    alone = trial.kind == "clock" and len(betters) < 2  # the inertia of one joint may be stated wrongly
    least = min(rest, nats(before, informative)) - nats(after, informative)
    if least < LEAST_GAIN or ratio.min() > MUCH or alone or after[betters].max() > GOOD:
        return None
    share = agreement(plain, signals, block, betters.tolist(), betters.tolist())
    if share < AGREE:
        return None
    shares = float(before[betters].mean()), float(after[betters].mean())
    joints = () if trial.joint < 0 else (trial.joint,)
    as_well = nats(after, informative) + TIE
    laws = {name: nats(left, informative) for name, left in missing_laws(evidence)}
    if any(name.startswith(SPRING) and left < nats(after, informative) - TIE for name, left in laws.items()):
        return None
    law = next((name for name, left in laws.items() if left <= as_well), "")
    return Distortion(trial.kind, joints, trial.value, *shares, share, signals, law)


def _trials(evidence: FaultEvidence, bad: bool) -> Iterator[_Trial]:
    """Candidates; bad: whether some torque is so badly explained that it may be late by seconds."""
    n = len(evidence.signed)
    for j in range(n):
        yield from (_Trial("position scale", j, factor) for factor in FACTORS)
        yield from (_Trial("position zero", j, angle) for angle in ANGLES if not evidence.robot.prismatic[j])
    if n > 1:
        yield from (_Trial("clock", -1, factor) for factor in TIMES)
    yield from (_Trial("square" if power < 1 else "square root", -1, power) for power in POWERS)
    yield from (_Trial(kind, -1, -1.0) for kind in ("reversed torque", "reversed positions", "reversed time"))
    most = min(LONGEST, PART * max(float(np.ptp(t)) for t in evidence.moments)) if bad else 0.0
    for lag in np.arange(LAG, most, STEP):
        yield from (_Trial("long lag", -1, side * float(lag)) for side in (1, -1))


def _finer(best: _Trial) -> Iterator[_Trial]:
    """Candidates around the best one."""
    if best.kind in ("position scale", "clock"):
        yield from (best._replace(value=best.value * factor) for factor in FINER)
    elif best.kind == "position zero":
        yield from (best._replace(value=best.value + angle) for angle in (-5.0, 5.0))
    elif best.kind == "long lag":
        yield from (best._replace(value=best.value + k * STEP / BETWEEN) for k in range(1 - BETWEEN, BETWEEN) if k)


def _undone(evidence: FaultEvidence, trial: _Trial) -> tuple[Signals, Indices]:
    """Signals without a distortion, and the rows of the evidence (K,) that they have."""
    x, rows, value = evidence.plain, np.arange(len(evidence.q)), trial.value
    own = np.arange(evidence.q.shape[1]) == trial.joint
    if trial.kind == "position scale":
        factor = np.where(own, value, 1.0)
        return _moved(evidence, evidence.q * factor, x.v * factor, x.a * factor), rows
    if trial.kind == "position zero":
        return _moved(evidence, evidence.q + np.radians(value) * own, x.v, x.a), rows
    if trial.kind == "clock":
        return _moved(evidence, evidence.q, value * x.v, value**2 * x.a), rows
    if trial.kind in ("square", "square root"):
        return x._replace(torque=np.sign(x.torque) * np.abs(x.torque) ** value), rows
    if trial.kind == "reversed time":
        return x._replace(v=-x.v, direction=-x.direction), rows
    if trial.kind == "long lag":
        return _late(evidence, value)
    ends = np.cumsum([len(t) for t in evidence.moments])
    back = np.concatenate([np.arange(e - len(t), e)[::-1] for t, e in zip(evidence.moments, ends, strict=True)])
    if trial.kind == "reversed torque":
        return x._replace(torque=x.torque[back]), rows
    return Signals(-x.v[back], x.a[back], -x.direction[back], x.predicted[back], x.torque), rows


def _moved(evidence: FaultEvidence, q: Array, v: Array, a: Array) -> Signals:
    """Signals with other motion; q, v, a: (K, n) [rad or m, and per s and s2]."""
    motion = Motion(evidence.robot, np.concatenate(evidence.moments), q, v, a)
    return evidence.plain._replace(v=v, a=a, predicted=evidence.model.inverse(motion))


def _late(evidence: FaultEvidence, lag: float) -> tuple[Signals, Indices]:
    """Signals of the rows for which torque is known when it is late by a lag [s]."""
    pairs = list(zip(evidence.torques, evidence.moments, strict=True))
    rows = np.flatnonzero(np.concatenate([(t + lag >= c.t[0]) & (t + lag <= c.t[-1]) for c, t in pairs]))
    torque = np.concatenate([curve.at(t + lag) for curve, t in pairs])
    return evidence.plain._replace(torque=torque).rows(rows), rows


def distortion_fault(found: Distortion, joints: Sequence[str], blocks: int) -> RecordingFault:
    """Fault with a sentence on its evidence and how to correct it."""
    about, side = joints[found.joints[0]] if found.joints else "", "late" if found.value > 0 else "early"
    times = max(found.value, 1 / found.value) if found.value > 0 else 1.0
    size, pace = ("small", "slowly") if found.value > 1 else ("large", "fast")
    fact, how, advice = KINDS[found.kind]
    fact = fact.format(
        joint=about, times=times, size=size, pace=pace, angle=-found.value, lag=abs(found.value), side=side
    )
    shares = f"{100 * (1 - found.after):.1f} % of the torque instead of {100 * (1 - found.before):.1f} %"
    better = f"better in {round(found.agreement * blocks)} of {blocks} blocks of the recordings"
    equally = f" (equally likely: {found.law})" if found.law else ""
    sentence = f"{fact}: {how}, model and friction explain {shares} ({better}){equally}; {advice}"
    measures = {"value": found.value, "explained_before": 1 - found.before, "explained_after": 1 - found.after}
    severity = WARN if found.kind in AMBIGUOUS or found.law else REFUSE
    about_joints = tuple(joints[j] for j in found.joints)
    return RecordingFault(found.kind, about_joints, severity, {**measures, "agreement": found.agreement}, sentence)
