"""Evidence -> positions that stand still although the torque shows that the joint moves on: a stuck sensor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..regression.session import Part
from ..types import Array, Mask
from .channels import longest_rows, true_runs
from .evidence import FaultEvidence
from .fits import fit_passive
from .result import REFUSE, RecordingFault

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
