"""Evidence -> samples against the description: lost signs, standstills of sensors, values beyond the limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..regression.session import Part
from ..types import Array, Mask, Robot
from .channels import longest_rows, true_runs
from .evidence import FaultEvidence, fit_passive
from .result import NOTE, REFUSE, WARN, RecordingFault

# Absolute torque: largest minimum of the torque over its maximum [1]; smallest share of the rows with the rarer sign of
# the predicted torque [1]; number of joints without negative torque that friction cannot explain; largest residual of
# the absolute predicted torque, over the residual of the signed one, and over the torque (sums of squares) [1]
NEAR, BOTH, SEVERAL = 0.02, 0.1, 2
BETTER, ALIKE = 0.5, 0.2
FAR = 0.05  # [ranges, or rad or m] excess of a position that is a rounding error of the description
STRONG, FAST, LARGE = 1.05, 1.2, 1.5  # [1] tolerated torque and velocity over their limits; torque that is a fault
LIMITS = {  # units of a revolute and of a prismatic joint; what to check
    "torque": (("N.m", "N"), "its unit"),
    "velocity": (("rad/s", "m/s"), "time and unit"),
    "position": (("rad", "m"), "its zero and unit"),
}


def absolute_torques(evidence: FaultEvidence, parts: Sequence[Part]) -> Mask:
    """Mask (n,) of joints with absolute values in a signed torque column.

    If at least one joint shows it, all joints whose torque is never negative are included.
    """
    predicted, torque = evidence.plain.predicted, evidence.plain.torque
    rarer = np.minimum((predicted > 0).mean(axis=0), (predicted < 0).mean(axis=0))
    sizes, plain = (np.sum((torque - p) ** 2, axis=0) for p in (np.abs(predicted), predicted))
    raw = np.concatenate([np.nan_to_num(longest_rows(part).tau) for part in parts])
    least, most = raw.min(axis=0), raw.max(axis=0)
    never = evidence.signed & (least >= 0) & (most > 0)
    touches = never & (least <= NEAR * most) & (rarer >= BOTH)
    alike = (sizes <= BETTER * plain) & (sizes <= ALIKE * np.sum(torque**2, axis=0))
    lost = touches & (alike | ((touches & (sizes < plain)).sum() >= SEVERAL))
    return np.asarray(never if lost.any() else lost)


def judge_limits(evidence: FaultEvidence | None, parts: Sequence[Part], robot: Robot) -> list[RecordingFault]:
    """Values beyond the limits of the description, with a tolerance for noise."""
    low, high, travel = robot.lower, robot.upper, robot.upper - robot.lower
    bottom, top = np.min([s.lower for _, s in parts], axis=0), np.max([s.upper for _, s in parts], axis=0)
    room = FAR * np.maximum(1.0, np.where(np.isfinite(travel), travel, 1.0))
    above, over = top - high >= low - bottom, (low < high) & ((top > high + room) | (bottom < low - room))
    found = [("position", np.where(above, top, bottom), np.where(above, high, low), over)]
    if evidence is not None:
        speed = np.abs(evidence.plain.v).max(axis=0)
        torque = np.max([np.abs(curve.x).max(axis=0) for curve in evidence.torques], axis=0)
        for kind, value, limit, most in (
            ("velocity", speed, robot.velocity_limit, FAST),
            ("torque", torque, robot.effort_limit, STRONG),
        ):
            found.append((kind, value, limit, (limit > 0) & (value > most * limit)))
    return [
        _limit_fault(kind, robot, int(j), float(value[j]), float(limit[j]))
        for kind, value, limit, exceeded in found
        for j in np.flatnonzero(exceeded)
    ]


def _limit_fault(kind: str, robot: Robot, j: int, value: float, limit: float) -> RecordingFault:
    units, check = LIMITS[kind]
    fact = f"the {kind} of {robot.joints[j]} reaches {value:.4g} {units[int(robot.prismatic[j])]}, beyond its limit"
    sentence = f"{fact} of {limit:.4g}; check {check}, or correct the description"
    severity = WARN if kind == "torque" and value >= LARGE * limit else NOTE
    measures = {"value": value, "limit": limit}
    return RecordingFault(f"{kind} limit", (robot.joints[j],), severity, measures, sentence)


LONG = 1.0  # [s] smallest duration of a standstill
# [1] smallest variation of the torque that the model does not explain in standstills, over the torque's variation
# elsewhere. Friction at rest alone varies less than that of a moving joint
MUCH = 0.6
# A joint also rests by static friction, which is about as large as the friction of the moving joint: quantiles of the
# torque that the model does not explain, largest static friction over their half range, and smallest share of rows
# beyond it
RANGE, BREAKAWAY, BEYOND = (2.0, 98.0), 1.5, 0.05
LEAST = 20  # rows in standstills, and elsewhere


def judge_standstills(evidence: FaultEvidence, parts: Sequence[Part]) -> list[RecordingFault]:
    """Faults of joints with signed torque whose position stands still for a second or longer, and moves elsewhere.

    A joint that rests by static friction is no fault: its torque stays within the friction of the moving joint.
    """
    found = list[RecordingFault]()
    for j, joint in enumerate(evidence.robot.joints):
        still, seconds = _standstills(evidence, parts, j)
        if not evidence.signed[j] or min(still.sum(), (~still).sum()) < LEAST:
            continue
        x, at_rest = (evidence.plain.joint(j).rows(rows) for rows in (~still, still))
        gain = float(fit_passive(x).gain[0, 0])
        rest = at_rest.torque - gain * at_rest.predicted
        share = float(np.std(rest)) / max(float(np.std(x.torque)), 1e-300)
        beyond = _beyond(rest, x.torque - gain * x.predicted)
        if gain > 0 and share >= MUCH and beyond >= BEYOND:
            fact = f"the position of {joint} stands still for {seconds:.2g} s while its torque varies as if it moved"
            advice = "the sensor is stuck: check it, or cut that part out"
            measures = {"seconds": seconds, "share": share, "beyond": beyond}
            found.append(RecordingFault("stuck position", (joint,), REFUSE, measures, f"{fact}; {advice}"))
    return found


def _beyond(rest: Array, moving: Array) -> float:
    """Share [1] of the torques at rest that static friction cannot hold, by those of the moving joint, both [N.m or N].

    A joint at rest holds any torque up to its breakaway friction; a joint whose sensor is stuck needs more or less.
    """
    low, high = np.percentile(moving, RANGE)
    return float(np.mean(np.abs(rest - (low + high) / 2) > BREAKAWAY * (high - low) / 2))


def _standstills(evidence: FaultEvidence, parts: Sequence[Part], joint: int) -> tuple[Mask, float]:
    """Mask (K,) of the rows in standstills, and the duration of the longest one [s]."""
    still, longest = np.zeros(len(evidence.q), dtype=bool), 0.0
    times, ends = evidence.moments, np.cumsum([len(t) for t in evidence.moments])
    for part in parts:
        rows = longest_rows(part)
        for a, b in true_runs(np.diff(rows.q[:, joint]) == 0):
            if (seconds := float(rows.t[b] - rows.t[a])) < LONG:
                continue
            longest = max(longest, seconds)
            for t, end in zip(times, ends, strict=True):
                if rows.t[0] <= t[0] and t[-1] <= rows.t[-1]:
                    still[end - len(t) : end] |= (t > rows.t[a]) & (t < rows.t[b])
    return still, longest
