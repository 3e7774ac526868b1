"""Evidence -> distortion of whole recordings: positions scaled or shifted, time scaled or reversed, torque nonlinear.

Each distortion is undone in turn, and other axes and other positions of held joints than those of the description are
tried alike. The best one is a fault if a passive joint with the model's bodies then explains the torque far better than
before, on several joints or nearly completely, in nearly all blocks of the recordings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import log
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..deadline import time_is_up
from ..regression.motion import Motion
from ..robot import held_positions, robot_from_text
from ..robot.dynamics import moved_bodies, own_body
from ..types import Array, Frozen, Indices, Mask, Robot
from .evidence import LAG, MIN_AGREED, SPRING, FaultEvidence, Signals, agreement, far_better, missing_laws, unexplained
from .result import REFUSE, WARN, RecordingFault, named

SEARCH = "the search for distorted recordings"
# [1] unexplained share that no distortion is needed for, and [nats] smallest reduction of the log unexplained shares.
# Measured: at most 1.2 on real and simulated arms, 2.7 and more for distortions of the 3r
FLOOR, LEAST_GAIN = 2e-3, 1.8
GOOD = 0.1  # [1] largest unexplained share of the improved joints after the correction
FACTORS = (0.1, 0.25, 1 / 3, 0.5, 0.7, 1.4, 2.0, 3.0, 4.0, 10.0)  # [1] on the position of a joint
TIMES = (0.25, 1 / 3, 0.5, 0.7, 1.4, 2.0, 3.0, 4.0)  # [1] on all velocities
ANGLES = tuple(15 * k for k in range(-11, 13) if abs(15 * k) >= 45)  # [degrees]; diagnosis has a law for smaller ones
FINER = (0.84, 0.92, 1.09, 1.19)  # [1] factors around the best one
POWERS = (0.5, 2.0)  # [1] that undo a square and a square root
# Long lags: [1] unexplained share of a joint from which on they are tried; [s] longest one; [1] its longest share of a
# recording; [s] step of the candidates, and number of finer steps in it
BAD, MAX_LONG_LAG, PART, STEP, BETWEEN = 0.1, 10.0, 0.4, 0.04, 8
ROWS = 400  # rows with which candidates are compared
# Held joints: largest number; [rad] first and finer steps of their positions; [nats] least reduction for each; [1]
# unexplained share of a joint that is not reduced further
MAX_HELD_JOINTS, GRID, STEPS, EACH, FINEST = 6, np.pi / 12, (0.12, 0.04, 0.013, 0.004), 0.9, 1e-4
# [1] smallest unexplained share of a joint whose other axes are tried; largest cosine of their angle to the stated one
ACCUSED, ASIDE = 0.01, 0.8
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
    "joint axis": (
        "the axis of {joint} is {found} in the frame of its link, {stated} in the description",
        "with that axis",
        "correct the axis in the description",
    ),
    "held joints": (
        "{joint}, held fixed in the model, stood at {found} rad, not at {stated}",
        "held there",
        "state this with {lock}, or record the positions",
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
DESCRIBED = ("joint axis", "held joints")  # faults of the description, tried where torque is badly explained
AMBIGUOUS = ("clock", "long lag")  # a diagnosis is still of use
JOINT = (  # alone, since Pinocchio's Python cannot build a continuous joint with any axis
    '<robot name="one"><link name="a"/><link name="b"/><joint name="j" type="{}"><parent link="a"/><child link="b"/>'
    '<axis xyz="{} {} {}"/><limit lower="0" upper="0" effort="0" velocity="0"/></joint></robot>'
)


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
    differences: tuple[tuple[str, str, str], ...] = ()  # joint, its stated and found axis or position when held [rad]


class _Trial(NamedTuple):
    kind: str
    joint: int  # -1: all
    value: float = 0.0
    vector: tuple[float, ...] = ()  # axis (3,) [1], or `rest` of the robot (nv,) [rad or m]


def nats(left: Array, informative: Mask, floor: float = FLOOR) -> float:
    """Sum of the log unexplained shares, left: (n,) [1], of informative torques; a small one does not count."""
    return float(np.sum(np.log(np.maximum(left[informative], floor))))


class DistortionSearch(NamedTuple):
    """The best distortion, if there is one, and the kinds of `DESCRIBED` that were tried."""

    found: Distortion | None = None
    tried: tuple[str, ...] = ()


def find_distortion(evidence: FaultEvidence, informative: Mask, rest: float) -> DistortionSearch:
    """Find the best distortion, if it leaves fewer nats than the best correction of order, sign and lag, `rest`."""
    before = unexplained(evidence.plain)
    if min(nats(before, informative), rest) - informative.sum() * log(FLOOR) < LEAST_GAIN:
        return DistortionSearch()
    few, scores, robot = thinned(evidence)[0], dict[_Trial, float](), evidence.robot
    bad = bool(np.any(before[informative] >= BAD))

    def left(trial: _Trial, floor: float = FLOOR) -> float:
        return nats(unexplained(_undone(few, trial)[0]), informative, floor)

    for trial in (*_turns(robot, informative & (before >= ACCUSED)), *_trials(evidence, bad)):
        if time_is_up(SEARCH, answer=False):
            return DistortionSearch()
        scores[trial] = left(trial)
    best, pose = min(scores, key=lambda trial: scores[trial]), _posed(robot, left)
    kinds = {trial.kind for trial in scores} | ({pose.kind} if pose else set())
    tried = DistortionSearch(None, tuple(kind for kind in DESCRIBED if kind in kinds))
    if pose and left(pose) <= scores[best] + TIE:
        return tried._replace(found=_judged(evidence, informative, pose, rest))
    if rest - scores[best] < LEAST_GAIN / 2:  # few rows: roughly
        return tried
    scores |= {trial: left(trial) for trial in _finer(best)}
    alike = [t for t, x in scores.items() if t.kind == best.kind and x <= min(scores.values()) + TIE]
    best = min(alike, key=lambda t: abs(log(t.value))) if best.kind == "clock" else min(scores, key=lambda t: scores[t])
    return tried._replace(found=_judged(evidence, informative, best, rest))


def _turns(robot: Robot, accused: Mask) -> Iterator[_Trial]:
    """The other axes of the frame of each accused joint and of the joint before it, in both directions."""
    moved, suspects = moved_bodies(robot), set[int]()
    for j in np.flatnonzero(accused).tolist():
        before = [i for i in np.flatnonzero(moved[:, own_body(robot, j)]).tolist() if i != j]
        suspects |= {j, *sorted(before, key=lambda i: moved[i].sum())[:1]}
    for j in sorted(suspects):
        if robot.model.joints[own_body(robot, j) + 1].nv == 1:  # no composite joint
            across = [e for e in np.eye(3) if abs(e @ _axis(robot, j)) < ASIDE]
            yield from (_Trial("joint axis", j, vector=tuple((side * e).tolist())) for e in across for side in (1, -1))


def _axis(robot: Robot, joint: int) -> Array:
    """Axis (3,) [1] of a joint in the frame of its link."""
    subspace = np.reshape(robot.model.joints[own_body(robot, joint) + 1].createData().S, 6)
    return subspace[:3] if robot.prismatic[joint] else subspace[3:]


def _posed(robot: Robot, left: Callable[[_Trial, float], float]) -> _Trial | None:
    """Positions of held revolute joints that explain most, one after the other; joints that explain little stay.

    Of the joints in the chains of those that move, the ones that move most mass are tried.
    """
    held = held_positions(robot)
    whole = robot_from_text(robot.document, robot.kind, robot.name)
    moved, masses = moved_bodies(whole), np.array([body.mass for body in list(whole.model.inertias)[1:]])
    chains = moved[[whole.index(joint) for joint in robot.joints]].any(axis=0)
    free = [j for j in map(whole.index, held) if not whole.prismatic[j] and (moved[j] & chains).any()]
    free = sorted(free, key=lambda j: -float(masses[moved[j]].sum()))[:MAX_HELD_JOINTS]
    if not free:
        return None
    stated, units = np.array([held[whole.joints[j]] for j in free]), np.eye(len(free))
    lower, upper = (np.clip(limit[free], -np.pi, np.pi) for limit in (whole.lower, whole.upper))

    def at(x: Array) -> _Trial:
        return _Trial("held joints", -1, vector=tuple(robot.rest + whole.drive[:, free] @ (x - stated)))

    def score(x: Array) -> float:
        return left(at(x), FINEST)

    def around(x: Array, step: float) -> list[Array]:
        return [x + side * step * e for e in units for side in (1, -1)]

    best = stated
    for k in [*range(len(free))] * min(len(free), 2):
        grid = [np.where(units[k], angle, best) for angle in np.arange(lower[k], upper[k], GRID)]
        best = min((best, *grid), key=score)
    best, _ = descend(score, best, around, STEPS)
    for e in units:
        back = np.where(e, stated, best)
        best = back if left(at(back), FLOOR) <= left(at(best), FLOOR) + EACH else best
    return at(best)


def descend(
    score: Callable[[Array], float], start: Array, around: Callable[[Array, float], list[Array]], steps: Sequence[float]
) -> tuple[Array, float]:
    """Point with the least score, and this score, by steps that become smaller; start: (k,) [any unit]."""
    best, left = start, score(start)
    for step in steps:
        while True:
            trials = around(best, step)
            scores = [score(x) for x in trials]
            if min(scores) >= left:
                break
            best, left = trials[int(np.argmin(scores))], min(scores)
    return best, left


def thinned(evidence: FaultEvidence) -> tuple[FaultEvidence, Indices]:
    """Evidence of every n-th row, up to `ROWS`, and the numbers of these rows."""
    every = -(-len(evidence.q) // ROWS)
    moments = tuple(t[::every] for t in evidence.moments)
    starts = np.cumsum([0, *(len(t) for t in evidence.moments)])[:-1]
    pairs = zip(starts, evidence.moments, strict=True)
    kept = np.concatenate([start + np.arange(0, len(t), every) for start, t in pairs])
    plain, block = evidence.plain.rows(kept), evidence.block[kept]
    return replace(evidence, q=evidence.q[kept], plain=plain, moments=moments, block=block), kept


def _judged(evidence: FaultEvidence, informative: Mask, trial: _Trial, rest: float) -> Distortion | None:
    signals, rows = _undone(evidence, trial)
    plain, block = evidence.plain.rows(rows), evidence.block[rows]
    before, after = unexplained(plain), unexplained(signals)
    betters = far_better(before, after, informative)
    alone = trial.kind == "clock" and len(betters) < 2  # the inertia of one joint may be stated wrongly
    least = min(rest, nats(before, informative)) - nats(after, informative)
    if least < LEAST_GAIN or not len(betters) or alone or after[betters].max() > GOOD:
        return None
    share = agreement(plain, signals, block, betters.tolist(), betters.tolist())
    if share < MIN_AGREED:
        return None
    shares = float(before[betters].mean()), float(after[betters].mean())
    joints = () if trial.joint < 0 else (trial.joint,)
    left = nats(after, informative)
    laws = {name: nats(shares, informative) for name, shares in missing_laws(evidence)}
    law = next((name for name, other in laws.items() if other <= left + TIE), "")
    springs = any(name.startswith(SPRING) and other < left - TIE for name, other in laws.items())
    if springs or (law and trial.kind in DESCRIBED):
        return None
    changes, robot = list[tuple[str, str, str]](), evidence.robot  # joint, what is stated of it, and what the trial has
    if trial.kind == "joint axis":
        old, new = (axis_words(axis) or "oblique" for axis in (_axis(robot, trial.joint), trial.vector))
        changes = [(robot.joints[trial.joint], old, new)]
    elif trial.kind == "held joints":
        held, least = held_positions(_described(robot, trial)), STEPS[-1] / 2
        stated = held_positions(robot).items()
        changes = [(j, f"{x:.2f}", f"{held[j]:.2f}") for j, x in stated if abs(held[j] - x) > least]
    return Distortion(trial.kind, joints, trial.value, *shares, share, signals, law, tuple(changes))


def axis_words(vector: Sequence[float] | Array) -> str:
    """Axis of the frame along a vector: "-y"; empty if it is oblique; vector: (3,) [any unit]."""
    k = int(np.argmax(np.abs(vector)))
    return f"{'-' if vector[k] < 0 else ''}{'xyz'[k]}" if np.count_nonzero(vector) == 1 else ""


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
    most = min(MAX_LONG_LAG, PART * max(float(np.ptp(t)) for t in evidence.moments)) if bad else 0.0
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
    mask = np.arange(evidence.q.shape[1]) == trial.joint
    if trial.kind == "position scale":
        factor = np.where(mask, value, 1.0)
        return _moved(evidence, evidence.q * factor, x.v * factor, x.a * factor), rows
    if trial.kind == "position zero":
        return _moved(evidence, evidence.q + np.radians(value) * mask, x.v, x.a), rows
    if trial.vector:
        other = replace(evidence, model=replace(evidence.model, robot=_described(evidence.robot, trial)))
        return _moved(other, evidence.q, x.v, x.a), rows
    if trial.kind == "clock":
        return _moved(evidence, evidence.q, value * x.v, value**2 * x.a), rows
    if trial.kind in ("square", "square root"):
        return x._replace(torque=np.sign(x.torque) * np.abs(x.torque) ** value), rows
    if trial.kind == "reversed time":
        return x._replace(v=-x.v, direction=-x.direction), rows
    if trial.kind == "long lag":
        pairs = list(zip(evidence.torques, evidence.moments, strict=True))
        known = np.concatenate([(t + value >= c.t[0]) & (t + value <= c.t[-1]) for c, t in pairs])
        rows = np.flatnonzero(known)
        return x._replace(torque=np.concatenate([curve.at(t + value) for curve, t in pairs])).rows(rows), rows
    ends = np.cumsum([len(t) for t in evidence.moments])
    back = np.concatenate([np.arange(e - len(t), e)[::-1] for t, e in zip(evidence.moments, ends, strict=True)])
    if trial.kind == "reversed torque":
        return x._replace(torque=x.torque[back]), rows
    return Signals(-x.v[back], x.a[back], -x.direction[back], x.predicted[back], x.torque), rows


def _described(robot: Robot, trial: _Trial) -> Robot:
    """Robot with another axis of a joint, or other positions of held joints; links and frames are kept."""
    if trial.kind == "held joints":
        return replace(robot, rest=np.array(trial.vector))
    model, k = robot.model.copy(), own_body(robot, trial.joint) + 1
    old = model.joints[k]
    kind = "prismatic" if robot.prismatic[trial.joint] else "revolute" if old.nq == 1 else "continuous"
    new = pin.buildModelFromXML(JOINT.format(kind, *trial.vector)).joints[1]
    new.setIndexes(old.id, old.idx_q, old.idx_v)
    model.joints[k] = new
    return replace(robot, model=model)


def _moved(evidence: FaultEvidence, q: Array, v: Array, a: Array) -> Signals:
    """Signals with other motion; q, v, a: (K, n) [rad or m, and per s and s2]."""
    motion = Motion(evidence.robot, np.concatenate(evidence.moments), q, v, a)
    return evidence.plain._replace(v=v, a=a, predicted=evidence.model.inverse(motion))


def distortion_fault(distortion: Distortion, joints: Sequence[str], blocks: int) -> RecordingFault:
    """Fault with a sentence on its evidence and how to correct it."""
    changes, value = distortion.differences, distortion.value
    about_joints = tuple(joint for joint, _, _ in changes) or tuple(joints[j] for j in distortion.joints)
    words = {
        "joint": named(about_joints) if about_joints else "",
        "times": max(value, 1 / value) if value > 0 else 1.0,
        "size": "small" if value > 1 else "large",
        "pace": "slowly" if value > 1 else "fast",
        "angle": -value,
        "lag": abs(value),
        "side": "late" if value > 0 else "early",
        "stated": " and ".join(stated for _, stated, _ in changes),
        "found": " and ".join(new for _, _, new in changes),
        "lock": " ".join(f"--lock {joint}={new}" for joint, _, new in changes),
    }
    fact, how, advice = (text.format(**words) for text in KINDS[distortion.kind])
    shares = f"{100 * (1 - distortion.after):.1f} % of the torque instead of {100 * (1 - distortion.before):.1f} %"
    better = f"better in {round(distortion.agreement * blocks)} of {blocks} blocks of the recordings"
    equally = f" (equally likely: {distortion.law})" if distortion.law else ""
    sentence = f"{fact}: {how}, model and friction explain {shares} ({better}){equally}; {advice}"
    measures = {"value": value, "explained_before": 1 - distortion.before, "explained_after": 1 - distortion.after}
    measures |= {joint: float(new) for joint, _, new in changes if distortion.kind == "held joints"}
    severity = WARN if distortion.kind in AMBIGUOUS or distortion.law else REFUSE
    return RecordingFault(
        distortion.kind, about_joints, severity, {**measures, "agreement": distortion.agreement}, sentence
    )
