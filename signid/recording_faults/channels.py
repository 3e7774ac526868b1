"""Recordings -> faults of single channels, values beyond the limits of the description, and the amount of data."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..regression.rows import consumed
from ..regression.session import PIECE, Part, Session
from ..types import Array, Mask, Robot, Samples
from .evidence import FaultEvidence
from .result import NOTE, WARN, RecordingFault

LEVELS = 200  # smallest number of distinct values; with fewer, a standstill looks like quantisation
# Clipping: smallest number of samples at the extreme value, their smallest share of all samples [1], and the smallest
# length of their longest run; their smallest number over that within a band below, and the width of the band [ranges]
OFTEN, SHARE, RUN = 10, 2e-3, 4
NEXT, BAND = 5.0, 5e-3
STILL, TRAVEL = 0.25, 0.02  # stuck torque: [s] smallest duration, and [ranges] smallest travel of the joint in it
# Skipping position: smallest duration [s] and number of samples of a standstill, and the smallest jump after it, over
# the largest of the five steps on either side [1]
HOLD, STEPS, JUMP = 0.05, 5, 3.0
# Absolute torque: largest minimum of the torque over its maximum [1]; smallest share of the rows with the rarer sign of
# the predicted torque [1]; number of joints without negative torque that friction cannot explain; largest residual of
# the absolute predicted torque, over the residual of the signed one, and over the torque (sums of squares) [1]
NEAR, BOTH, SEVERAL = 0.02, 0.1, 2
BETTER, ALIKE = 0.5, 0.2
PER_UNKNOWN = 2.5  # smallest number of rows per unknown, for the joint with most unknowns, to estimate noise
BEYOND = 3.0  # [1] largest cut-off over the highest frequency of the motion
MOTION = 6.25  # [Hz] highest frequency of a motion; rows beyond it have no new information
FAR = 0.05  # [ranges, or rad or m] excess of a position that is a rounding error of the description
STRONG, FAST, LARGE = 1.05, 1.2, 1.5  # [1] tolerated torque and velocity over their limits; torque that is a fault
CHANNELS = {
    "clipping": "the torque of {joint} is clipped at {value:.4g} {unit} in {count} samples; "
    "raise the limit of drive or logger, or move more slowly",
    "stuck torque": "the torque of {joint} is constant for {value:.2g} s while the joint moves; "
    "check the logger, or cut that part out",
    "skipping position": "the position of {joint} stands still and then jumps, {count} times, for up to {value:.2g} s: "
    "samples were lost; leave them empty instead of repeating the last one",
}
LIMITS = {  # units of a revolute and of a prismatic joint; what to check
    "torque": (("N.m", "N"), "its unit"),
    "velocity": (("rad/s", "m/s"), "time and unit"),
    "position": (("rad", "m"), "its zero and unit"),
}


class Amount(NamedTuple):
    """Amount of data."""

    rows: int  # filtered rows of all recordings with new information
    unknowns: int  # of the joint with most of them
    seconds: float  # [s] of training data
    needed: float  # [s] of training data needed for `PER_UNKNOWN`
    whole: float  # [s] of training data and held-out data of the same recordings

    @property
    def enough(self) -> bool:
        """Whether there are enough rows to distinguish noise from unknowns."""
        return self.rows >= PER_UNKNOWN * self.unknowns


def judge_channels(parts: Sequence[Part], robot: Robot) -> list[RecordingFault]:
    """Faults of single channels in the longest stretch of each recording; each kind at most once per joint."""
    found: dict[tuple[str, int], RecordingFault] = {}
    for part in parts:
        (recording, sampling), rows = part, longest_rows(part)
        for j, signed in enumerate(recording.signed):
            joint, unit = robot.joints[j], "N" if robot.prismatic[j] else "N.m"
            for kind, count, value in _faults(rows.q[:, j], rows.tau[:, j], sampling.period, bool(signed)):
                measures = {"count": float(count), "value": value}
                sentence = CHANNELS[kind].format(joint=joint, unit=unit, count=count, value=value)
                found.setdefault((kind, j), RecordingFault(kind, (joint,), WARN, measures, sentence))
    return list(found.values())


def longest_rows(part: Part) -> Samples:
    """Raw samples of a recording's longest stretch, or its beginning if it is long."""
    recording, sampling = part
    start, stop = max(sampling.spans, key=lambda span: span[1] - span[0])
    return recording.read(start, min(stop, start + PIECE))


def _faults(q: Array, tau: Array, period: float, signed: bool) -> Iterator[tuple[str, int, float]]:
    """Kind, number of samples or skips, and clipped value [N.m or N] or longest duration [s] of each fault."""
    if np.all(np.isfinite(tau)) and len(np.unique(tau)) >= LEVELS:
        sides = [(_clipped(side * tau, q), side) for side in (1.0, -1.0)[: 1 + signed]]
        yield from (("clipping", count, float(np.max(side * tau))) for count, side in sides if count)
        if not any(count for count, _ in sides) and (stuck := _stuck(tau, q, period)):
            yield "stuck torque", stuck, stuck * period
    if skips := _skips(q, period):
        yield "skipping position", len(skips), max(skips) * period


def _clipped(y: Array, q: Array) -> int:
    """Number of samples at the largest value if it is clipped: many are there and few just below; else 0."""
    at = y >= y.max() - 1e-9 * np.ptp(y)
    levels = np.unique(y)[-2:]
    band = max(BAND * np.ptp(y), 1.5 * (levels[1] - levels[0]))
    below = np.sum((y > y.max() - band) & ~at)
    runs = true_runs(at)
    moving = np.mean(np.diff(q, prepend=q[0])[at] != 0)
    many = at.sum() >= max(OFTEN, SHARE * len(y), NEXT * below) and moving > 0.3
    return int(at.sum()) if many and len(runs) > 1 and max(b - a for a, b in runs) >= RUN else 0


def _stuck(y: Array, q: Array, period: float) -> int:
    """Length in samples of the longest stretch with constant value while the position changes."""
    runs = [(a, b) for a, b in true_runs(np.diff(y) == 0) if (b - a) * period >= STILL]
    far = TRAVEL * np.ptp(q)
    return max((b - a + 1 for a, b in runs if np.ptp(q[a : b + 1]) > far), default=0)


def _skips(q: Array, period: float) -> list[int]:
    """Length in samples of each standstill of a position that a jump follows."""
    step, found = np.diff(q), []
    for a, b in true_runs(step == 0):
        before, after = np.abs(step[max(a - STEPS, 0) : a]), np.abs(step[b + 1 : b + 1 + STEPS])
        if b - a < max(STEPS, HOLD / period) or len(before) < STEPS or len(after) < STEPS:
            continue
        usual = max(before.max(), after.max())
        if before.min() > 0 and after.min() > 0 and abs(step[b]) > JUMP * usual:
            found.append(b - a)
    return found


def true_runs(mask: Mask) -> list[tuple[int, int]]:
    """Start and end (exclusive) of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def judge_absolute(evidence: FaultEvidence, parts: Sequence[Part]) -> Mask:
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


def judge_amount(session: Session, parts: Sequence[Part]) -> Amount:
    """Number of filtered rows and of unknowns."""
    band, task = session.task.band, session.task
    reach = consumed(band, task.recorded_derivatives)
    lengths = [s.length(span) for _, s in parts for span in s.spans]
    density, lost = 2 * min(band.cutoff, max(MOTION, band.cutoff / BEYOND)), len(lengths) * reach / band.rate
    rows = sum(int(max(0, length - reach) / band.rate * density) for length in lengths)
    unknowns = max((len(task.seen(j)) for j in range(len(task.robot.joints))), default=0)
    seconds, wanted = sum(s.duration for _, s in parts), PER_UNKNOWN * unknowns
    rest = sum(s.duration for r, s in session.held_out if any(r is used and s is not own for used, own in parts))
    needed = max(wanted / density + lost, seconds * wanted / max(rows, 1))
    return Amount(rows, unknowns, seconds, needed, seconds + rest)
